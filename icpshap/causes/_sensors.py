"""What is published of the range noise of common scanners, as it is published.

`SENSORS` has what a source says of a scanner: the standard deviation of a range, or its accuracy,
which is no standard deviation but all that the sheet says. Scanners of which the sheet says it by
the strength of the signal have an entry for each.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

SIGMA, ACCURACY = "standard deviation", "accuracy"


@dataclass(frozen=True)
class Sensor:
    """`published` [m] of ranges (n,) [m] is what the source says of the scanner `title`.

    says: SIGMA or ACCURACY; formula: the same in words; source: where it stands.
    """

    title: str
    says: str
    published: Callable
    formula: str
    source: str


def _beam(smallest, slope, constant):
    """The model of libpointmatcher: max(smallest, slope r + constant)."""
    return lambda ranges: np.maximum(smallest, slope * ranges + constant)


def _constant(value):
    return lambda ranges: np.full_like(ranges, value)


def _steps(near, limit, far):
    return lambda ranges: np.where(ranges < limit, near, far)


LIBPOINTMATCHER = "libpointmatcher, SimpleSensorNoiseDataPointsFilter"
OS1 = "Ouster OS1, data sheet, range repeatability (1 sigma)"

SENSORS = {
    "hokuyo_utm_30lx": Sensor(
        "Hokuyo UTM-30LX",
        SIGMA,
        _beam(0.018, 0.0006, 0.0015),
        "max(0.018, 0.0006 r + 0.0015)",
        LIBPOINTMATCHER,
    ),
    "hokuyo_urg_04lx": Sensor(
        "Hokuyo URG-04LX",
        SIGMA,
        _beam(0.028, 0.0013, 0.0001),
        "max(0.028, 0.0013 r + 0.0001)",
        LIBPOINTMATCHER,
    ),
    "sick_lms_1xx": Sensor(
        "SICK LMS1xx",
        SIGMA,
        _beam(0.012, 0.0068, 0.0008),
        "max(0.012, 0.0068 r + 0.0008)",
        LIBPOINTMATCHER,
    ),
    "sick_tim_3xx": Sensor(
        "SICK TiM3xx",
        SIGMA,
        _beam(0.004, 0.0053, -0.0092),
        "max(0.004, 0.0053 r - 0.0092)",
        LIBPOINTMATCHER,
    ),
    "ouster_os1_snr_250": Sensor(
        "Ouster OS1, signal-to-noise ratio above 250", SIGMA, _constant(0.015), "0.015", OS1
    ),
    "ouster_os1_snr_100": Sensor(
        "Ouster OS1, signal-to-noise ratio 100", SIGMA, _constant(0.03), "0.03", OS1
    ),
    "ouster_os1_snr_12": Sensor(
        "Ouster OS1, signal-to-noise ratio 12", SIGMA, _constant(0.1), "0.1", OS1
    ),
    "hokuyo_utm_30lx_ew": Sensor(
        "Hokuyo UTM-30LX-EW",
        ACCURACY,
        _steps(0.03, 10.0, 0.05),
        "0.03 below 10 m, 0.05 beyond",
        "Hokuyo UTM-30LX-EW, data sheet",
    ),
    "velodyne_vlp_16": Sensor(
        "Velodyne VLP-16", ACCURACY, _constant(0.03), "0.03", "Velodyne VLP-16, data sheet"
    ),
    "velodyne_hdl_64e": Sensor(
        "Velodyne HDL-64E", ACCURACY, _constant(0.02), "0.02", "Velodyne HDL-64E, data sheet"
    ),
}
