"""A covariance of a pose with its order, frame and units, and in the conventions of others."""

from dataclasses import dataclass, replace

import numpy as np

from icpshap import conventions
from icpshap.errors import UserError

ROTATION_FIRST, TRANSLATION_FIRST = "rotation first", "translation first"
SOURCE_FRAME = "of xi in T_reference_source exp(xi), in the frame of the source"
REFERENCE_AXES = (
    "of the translation of the source in the axes of the reference, and of its turn about them"
)
CONVENTIONS = ("icpshap", "gtsam", "ros")


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """matrix (6, 6) [rad, m]; `numpy.asarray` of it gives the matrix.

    order: which three rows come first; frame: what it is the covariance of; share_of_points: of the
    source's points that the chain leaves, what a run used: with all of them, if points count alike
    and do not depend on one another, the covariance would be that share of it
    (`of_all_points`); left_out: share of the runs that it is not of, since they failed or ended in
    a wrong basin; T_reference_source (4, 4): the pose that it stands at; scaled: whether it has
    been.
    """

    matrix: np.ndarray
    share_of_points: float
    left_out: float
    T_reference_source: np.ndarray
    order: str = ROTATION_FIRST
    frame: str = SOURCE_FRAME
    scaled: bool = False

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.matrix, dtype=dtype)

    @property
    def unit(self) -> str:
        """Units of its blocks: of the first three rows, of both, of the last three."""
        first, second = ("rad", "m") if self.order == ROTATION_FIRST else ("m", "rad")
        return f"{first}^2, {first} {second}, {second}^2"

    @property
    def standard_deviations(self) -> np.ndarray:
        """Square roots of its diagonal (6,), in its order [rad, m]."""
        return np.sqrt(np.diagonal(self.matrix))

    def to(self, convention: str) -> "PoseCovariance":
        """The same as another program has it.

        gtsam: rotation first, in the source's frame: the tangent vector of gtsam.Pose3, as here.
        ros: translation first, along and about the fixed axes of the reference:
        geometry_msgs/PoseWithCovariance of the source's pose in the reference. Raises UserError.

        >>> turned = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        >>> found = PoseCovariance(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), 0.5, 0.0, turned)
        >>> found.to("ros").standard_deviations.round(2).tolist()
        [2.24, 2.0, 2.45, 1.41, 1.0, 1.73]
        """
        if convention not in CONVENTIONS:
            raise UserError(
                f"convention {convention!r}, expected one of {', '.join(CONVENTIONS)}.\n"
                "Hint: to('ros') for a PoseWithCovariance, to('gtsam') for a Pose3."
            )
        if self.order != ROTATION_FIRST:
            raise UserError(
                "This covariance is in the convention of ros already.\n"
                "Hint: ask the covariance that the explanation has."
            )
        if convention != "ros":
            return self
        return replace(
            self,
            matrix=conventions.ros(self.matrix, self.T_reference_source),
            order=TRANSLATION_FIRST,
            frame=REFERENCE_AXES,
        )

    def of_all_points(self) -> "PoseCovariance":
        """It times the share of the points that a run used: a scaling, no measurement.

        What no point takes away does not fall so; see `Explanation.covariance_all_points`.

        >>> found = PoseCovariance(np.eye(6), 0.25, 0.0, T_reference_source=np.eye(4))
        >>> found.of_all_points().standard_deviations.tolist()
        [0.5, 0.5, 0.5, 0.5, 0.5, 0.5]
        """
        return replace(self, matrix=self.matrix * self.share_of_points, scaled=True)

    def __repr__(self) -> str:
        rows = "\n".join("  " + " ".join(f"{entry: .3e}" for entry in row) for row in self.matrix)
        return f"{self.in_words()}\n{rows}"

    def in_words(self) -> str:
        """Order, units, frame and share of the points, in one line."""
        points = f"of runs that used {self.share_of_points:.3g} of the points"
        if self.scaled:
            points = (
                f"scaled by {self.share_of_points:.3g}, the share of the points that runs used, "
                "too small for what all points share"
            )
        if self.left_out > 0:
            lost = f"{self.left_out:.0%} of the runs that failed or ended in a wrong basin"
            points += f"; WITHOUT the {lost}"
        return f"Covariance [{self.unit}], {self.order}, {self.frame}; {points}"

    def to_dict(self) -> dict:
        """Plain data, for JSON."""
        return {
            "matrix": self.matrix.tolist(),
            "order": self.order,
            "unit": self.unit,
            "frame": self.frame,
            "share_of_points": self.share_of_points,
            "left_out": self.left_out,
            "scaled": self.scaled,
        }
