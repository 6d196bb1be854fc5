"""Pairs like those of scanners that people have: what does not fit is named, and mended so."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from fitted_pairs import LEVELS, corner_pair, fit, ring_pair

from icpshap.presets import LIDAR, PAPER

YARD = ((-12, -12, 22), (20, 20, -1.5))  # m, from a scanner 1.5 m above the ground


@pytest.fixture(scope="module")
def office():
    """2 m and 41 degrees apart, 62,000 points, so dense that 7 of them lie within 4 cm."""
    motion = (0, 0, np.deg2rad(41), 2.0, 0.3, 0.1)
    return corner_pair((-2, -2, 1.5), (3, 3, -1.5), 1128, motion)


@pytest.fixture(scope="module")
def yard():
    """Planes 1.1 m apart, 25,000 points, so sparse that 7 of them lie within 43 cm."""
    return corner_pair(*YARD, 9.8, (0, 0, 0.02, 1.1, 0, 0))


def not_fitting(found):
    return found[found.grade != "fits"].grade.to_dict()


@pytest.mark.parametrize(("count", "motion"), [(16, 0.7), (32, 0.5)])
def test_the_remedy_for_rings_mends_them_and_so_does_lidar(count, motion):
    pair = ring_pair(count, 1200, motion)
    row = fit(pair).loc["rings"]
    assert row.grade == "red"
    mended = PAPER.with_options(**yaml.safe_load(f"{{{row.remedy}}}"))
    assert fit(pair, mended).loc["rings"].grade == "fits"
    lidar = fit(pair, LIDAR, {**LEVELS, "sensor_noise": 0.02})
    assert lidar.loc[["rings", "normals", "points"]].grade.tolist() == ["fits"] * 3


def test_normals_of_an_office_are_narrower_than_the_noise_and_more_neighbours_mend_it(office):
    found = fit(office).loc["normals"]
    assert (found.grade, found.remedy) == ("remark", "normal_neighbours: 15")
    assert found.value == pytest.approx(0.04, rel=0.02)
    assert fit(office, PAPER.with_options(normal_neighbours=15)).loc["normals"].grade == "fits"


def test_noise_of_a_depth_camera_is_six_times_what_normals_span():
    pair = corner_pair((1.0, -0.4, -0.4), (1.8, 0.4, 0.4), 26_000, (0, 0, 0, 0.11, 0, 0))
    found = fit(pair).loc["normals"]
    assert 0.05 / found.value == pytest.approx(6, rel=0.02)
    assert (found.grade, found.remedy) == ("remark", "voxel_size: 0.1, and normal_neighbours: 20")
    mended = PAPER.with_options(voxel_size=0.1, normal_neighbours=20)
    assert fit(pair, mended).loc["normals"].grade == "fits"


def test_of_sparse_planes_all_fits_but_the_overlap_distance(yard):
    found = fit(yard)
    assert found.loc["normals"].value == pytest.approx(0.43, rel=0.02)
    # Three quarters of the nearest of 9.8 points a square metre: exp(-9.8 pi r^2) = 1/4.
    near = np.sqrt(np.log(4) / (9.8 * np.pi))
    assert found.loc["overlap distance"].value == pytest.approx(near, rel=0.02)
    assert not_fitting(found) == {"overlap distance": "remark"}
    assert found.loc["overlap distance"].remedy == "perturbation: {overlap_distance: 0.22}"
    assert not_fitting(fit(replace(yard, overlap_distance=0.22))) == {}


@pytest.mark.parametrize(
    ("density", "probability", "grade"),
    [(8, 0.05, "remark"), (8, 0.25, "fits"), (2, 0.05, "red"), (2, 0.25, "fits")],
)
def test_thin_scans_leave_few_points_of_a_run(density, probability, grade):
    pair = corner_pair(*YARD, density)  # 20,000 and 5,000 points
    found = fit(pair, PAPER.with_options(subsampling_probability=probability)).loc["points"]
    assert found.grade == grade
    assert ("subsampling_probability: " in found.remedy) == (grade != "fits")


def test_of_dense_scans_half_is_more_than_it_takes(office):
    found = fit(office, PAPER.with_options(subsampling_probability=0.5)).loc["points"]
    assert 28_000 < found.value < 31_000
    assert found.grade == "remark"
    assert found.remedy == "subsampling_probability: 0.2, which is faster"


def test_in_the_frame_of_a_vehicle_nothing_is_near():
    near, far = YARD
    found = fit(corner_pair(near, (*far[:2], -2.9), 9.8)).loc["minimum range"]
    assert found.grade == "remark" and "the nearest return is 2.9 m away" in found.sentence


def test_points_that_are_there_twice_are_counted(yard):
    found = fit(replace(yard, reference=np.repeat(yard.reference, 2, axis=0))).loc["duplicates"]
    assert found.grade == "remark" and "33.3% of the points lie where" in found.sentence
