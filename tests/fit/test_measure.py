"""Numbers of a pair that say whether the options fit: known answers, and the real pairs."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import folder_in
from fitted_pairs import LEVELS, fit, numbers, rings

from benchmarks import real_pairs
from icpshap import se3
from icpshap.fit.measure import duplicate_share, normals
from icpshap.presets import LIDAR, PAPER


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_neighbourhoods_on_one_ring_are_found_whatever_the_noise_along_the_beams(noise):
    found = normals(rings(16, 2000, noise), (7, 0.0))
    assert found["ring_share"] > 0.95
    assert (found["line_share"] > 0.9) == (noise == 0.0)
    scattered = 5.0 * se3.exp(np.random.default_rng(0).normal(size=(20_000, 6)))[:, :3, 0]
    assert normals(scattered, (9, 0.0))["ring_share"] < 0.02


def test_the_radius_is_that_of_the_neighbours_or_the_one_asked_for():
    generator = np.random.default_rng(0)
    plane = np.column_stack([generator.random((20_000, 2)) * 10, np.full(20_000, 3.0)])
    # n neighbours of a density of 200 a square metre lie within a circle of the area n / 200.
    assert normals(plane, (20, 0.0))["normal_radius"] == pytest.approx(
        np.sqrt(20 / 200 / np.pi), rel=0.05
    )
    assert normals(plane, (7, 0.5))["normal_radius"] == 0.5
    assert np.isnan(normals(plane, None)["normal_radius"])


def test_duplicates_are_counted_in_each_cloud():
    cloud = np.arange(30.0).reshape(10, 3)
    assert duplicate_share(cloud, cloud) == 0.0
    assert duplicate_share(np.concatenate([cloud, cloud[:5]]), cloud) == 5 / 25


def test_points_of_a_run_are_those_of_the_largest_levels(room_pair):
    found = numbers(room_pair, PAPER.with_options(subsampling_probability=1.0))
    assert found["source_points"] == len(room_pair.source) - round(0.05 * len(room_pair.reference))
    assert found["overlap"] == room_pair.overlap
    assert found["median_distance"] < 0.2 and found["better_pose"] == ""


def test_a_pair_that_cannot_be_perturbed_has_no_points_of_a_run(room_pair):
    nothing = replace(room_pair, overlapping=np.zeros_like(room_pair.overlapping))
    assert np.isnan(numbers(nothing)["source_points"])


def test_millimetres_are_named(room_pair):
    T = room_pair.T_reference_source.copy()
    T[:3, 3] *= 1000
    scaled = replace(
        room_pair,
        reference=1000 * room_pair.reference,
        source=1000 * room_pair.source,
        T_reference_source=T,
    )
    assert fit(scaled).loc["units"].grade == "red"


def test_the_inverse_of_the_pose_is_named(room_pair):
    inverse = replace(room_pair, T_reference_source=se3.inverse(room_pair.T_reference_source))
    assert fit(inverse).loc["true pose"].grade == "red"


def test_the_papers_options_have_no_red_row_on_the_apartment():
    folder_in("ICPSHAP_REAL_DATA")
    found = fit(real_pairs.real_pair("apartment"))
    assert "red" not in set(found.grade)
    assert found.loc["normals"].grade == "remark"


def test_rings_are_red_with_the_papers_options_and_gone_with_lidar():
    folder_in("ICPSHAP_REAL_DATA")
    pair = real_pairs.real_pair("spinning")
    assert 0.5 < numbers(pair)["line_share"] < 0.62
    row = fit(pair).loc["rings"]
    assert row.grade == "red" and row.remedy == "voxel_size: 0.25, normal_neighbours: 20"
    lidar = fit(pair, LIDAR, {**LEVELS, "sensor_noise": 0.02})
    assert set(lidar.grade) == {"fits"}
