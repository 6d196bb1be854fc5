"""Messages geometry_msgs/PoseWithCovarianceStamped as YAML, as `ros2 topic echo` prints them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import yaml

from icpshap import conventions
from icpshap.export.format import Format

if TYPE_CHECKING:
    from icpshap.export.measurement import Measurement


class Ros(Format):
    name = "ros"
    meaning = "geometry_msgs/PoseWithCovarianceStamped as YAML, of each source in its reference"

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        return {"": "---\n".join(map(_message, measurements))}


def _message(one):
    covariance = conventions.ros(one.covariance, one.T_reference_source)
    message = {
        "header": {"frame_id": f"scan_{one.reference}"},
        "pose": {
            "pose": {
                "position": dict(zip("xyz", one.translation.tolist(), strict=True)),
                "orientation": dict(zip("xyzw", one.quaternion.tolist(), strict=True)),
            },
            "covariance": covariance.ravel().tolist(),
        },
    }
    said = yaml.safe_dump(message, default_flow_style=None, sort_keys=False, width=100)
    return f"# {one.sequence}: scan_{one.source} in scan_{one.reference}\n{said}"
