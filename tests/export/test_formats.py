"""The formats: their own readers, where they are installed, find the poses and covariances."""

import json
import math

import numpy as np
import pandas as pd
import pytest
import yaml
from known_measurements import POSES, covariance, drive, table

from icpshap import se3
from icpshap.data.poses import read_poses
from icpshap.errors import UserError
from icpshap.export import FORMATS, tum
from icpshap.export.g2o import information
from icpshap.export.measurement import Measurement, measurements, placed

FACTOR = 4  # both causes on


def texts(name, measured=None):
    return FORMATS[name]().texts(drive() if measured is None else measured)


def measured(reference, source, T, S=None, sequence="drive"):
    S = covariance(0) if S is None else S
    return Measurement(sequence, reference, source, {}, T, S, 100, 100)


def write(tmp_path, name):
    path = tmp_path / f"drive.{name}"
    path.write_text(texts(name)[""])
    return path


# --- g2o and GTSAM --------------------------------------------------------------------------------


def test_g2o_reads_the_graph_and_weighs_an_error_as_the_covariance_does(tmp_path):
    g2o = pytest.importorskip("g2opy", reason="g2o's own reader: pip install g2opy")
    optimizer = g2o.SparseOptimizer()
    assert optimizer.load(str(write(tmp_path, "g2o")))
    assert len(optimizer.vertices()) == 4 and optimizer.vertex(0).fixed()
    edges = {edge.vertices()[0].id(): edge for edge in optimizer.edges()}
    generator = np.random.default_rng(0)
    for pair, T in enumerate(POSES):
        edge = edges[pair]
        np.testing.assert_allclose(edge.measurement().matrix(), T, atol=1e-9)
        edge.compute_error()
        assert edge.chi2() == pytest.approx(0, abs=1e-6)  # the vertices lie as the edges say
        S = covariance(pair, FACTOR)
        moved = edge.vertices()[1]
        there = moved.estimate().matrix()
        for _ in range(20):
            xi = 0.1 * np.linalg.cholesky(S) @ generator.standard_normal(6)
            moved.set_estimate(g2o.Isometry3d(there @ se3.exp(xi)))
            edge.compute_error()
            assert edge.chi2() == pytest.approx(xi @ np.linalg.solve(S, xi), rel=2e-3)
        moved.set_estimate(g2o.Isometry3d(there))


def test_gtsam_reads_factors_with_the_covariance_of_its_own_tangent_vector(tmp_path):
    gtsam = pytest.importorskip("gtsam", reason="GTSAM's own reader: pip install gtsam")
    graph, initial = gtsam.readG2o(str(write(tmp_path, "gtsam")), True)
    assert graph.size() == 3 and initial.size() == 4
    xi = np.array([0.1, -0.3, 0.2, 1.0, 2.0, -1.0])
    np.testing.assert_allclose(gtsam.Pose3.Expmap(xi).matrix(), se3.exp(xi), atol=1e-12)
    for pair, T in enumerate(POSES):
        factor = graph.at(pair)
        assert list(factor.keys()) == [pair, pair + 1]
        np.testing.assert_allclose(factor.measured().matrix(), T, atol=1e-9)
        S = covariance(pair, FACTOR)
        np.testing.assert_allclose(factor.noiseModel().covariance(), S, rtol=1e-6, atol=1e-14)
    assert graph.error(initial) == pytest.approx(0, abs=1e-9)


def edges_of(text):
    """(indices, pose (7,), information (6, 6)) of each edge."""
    for line in text.splitlines():
        word, *numbers = line.split()
        if word == "EDGE_SE3:QUAT":
            upper = np.zeros((6, 6))
            upper[np.triu_indices(6)] = np.array(numbers[9:], dtype=float)
            whole = upper + np.triu(upper, 1).T
            yield [int(n) for n in numbers[:2]], np.array(numbers[2:9], dtype=float), whole


def test_the_graphs_differ_by_half_a_turn_alone():
    of_g2o, of_gtsam = (list(edges_of(texts(name)[""])) for name in ("g2o", "gtsam"))
    double = np.diag([1, 1, 1, 2, 2, 2])
    for pair, ((ids, pose, found), (_, _, other)) in enumerate(zip(of_g2o, of_gtsam, strict=True)):
        assert ids == [pair, pair + 1]
        np.testing.assert_array_equal(pose[:3], POSES[pair][:3, 3])
        assert pose[6] > 0 and np.linalg.norm(pose[3:]) == pytest.approx(1)
        np.testing.assert_allclose(found, double @ other @ double, rtol=1e-9)
        S = covariance(pair, FACTOR)[[3, 4, 5, 0, 1, 2]][:, [3, 4, 5, 0, 1, 2]]
        np.testing.assert_allclose(other @ S, np.eye(6), atol=1e-9)


def test_a_covariance_without_an_inverse_is_refused():
    flat = np.diag([1.0, 1, 1, 1, 1, 0]) * 1e-6
    with pytest.raises(UserError, match=r"drive 0-1: the covariance is singular[\s\S]*Hint"):
        texts("g2o", [measured(0, 1, POSES[0], flat)])
    rank_one = np.full((6, 6), 1e-6)
    with pytest.raises(UserError, match="singular"):
        information(rank_one, "drive 0-1")


def test_scans_stand_where_the_measurements_put_them():
    a, b, c = POSES
    poses, firsts = placed([measured(2, 1, b), measured(2, 3, a), measured(7, 9, c)])
    assert list(poses) == [1, 2, 3, 7, 9] and firsts == [1, 7]
    np.testing.assert_allclose(poses[2], se3.inverse(b), atol=1e-12)
    np.testing.assert_allclose(poses[3], se3.inverse(b) @ a, atol=1e-12)
    np.testing.assert_allclose(poses[9], c, atol=1e-12)


@pytest.mark.parametrize("name", ["g2o", "gtsam", "tum"])
def test_indices_of_two_sequences_do_not_mix(name):
    mixed = [measured(0, 1, POSES[0]), measured(1, 2, POSES[1], sequence="other")]
    with pytest.raises(UserError, match=r"sequences drive, other, expected one[\s\S]*--sequence"):
        texts(name, mixed)


# --- TUM ------------------------------------------------------------------------------------------


def test_tum_is_a_trajectory_and_a_file_of_covariances(tmp_path):
    found = texts("tum")
    assert list(found) == ["", "_covariances"]
    path = tmp_path / "drive.txt"
    path.write_text(found[""])
    poses = read_poses(path, 4)
    np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(poses[3], POSES[0] @ POSES[1] @ POSES[2], atol=1e-9)
    spreads = np.loadtxt(found["_covariances"].splitlines())
    assert spreads.shape == (4, 1 + 21)
    assert (spreads[0, 1:] == 0).all()
    np.testing.assert_array_equal(spreads[1, 1:], covariance(0, FACTOR)[np.triu_indices(6)])


def test_evo_reads_the_trajectory(tmp_path):
    files = pytest.importorskip("evo.tools.file_interface", reason="pip install evo")
    trajectory = files.read_tum_trajectory_file(str(write(tmp_path, "tum")))
    assert trajectory.num_poses == 4
    np.testing.assert_allclose(trajectory.poses_se3[1], POSES[0], atol=1e-9)


def test_errors_of_a_chain_compound():
    chain = [measured(k, k + 1, T, covariance(k)) for k, T in enumerate(POSES)]
    generator = np.random.default_rng(0)
    reached = np.eye(4)
    for one in chain:
        xi = 0.1 * generator.standard_normal((20_000, 6)) @ np.linalg.cholesky(one.covariance).T
        reached = reached @ (one.T_reference_source @ se3.exp(xi))
    index, T, found = tum.compounded(chain)[-1]
    assert index == 3
    expected = 100 * np.cov(se3.log(se3.inverse(T) @ reached).T)
    scale = np.sqrt(np.diagonal(expected))
    difference = (found - expected) / np.outer(scale, scale)
    assert np.abs(difference).max() < 6 / math.sqrt(20_000)


def test_what_is_no_chain_is_no_trajectory():
    with pytest.raises(UserError, match=r"drive 4-5 does not go on from scan 1[\s\S]*Hint"):
        texts("tum", [measured(0, 1, POSES[0]), measured(4, 5, POSES[1])])


# --- JSON, ROS, tables ----------------------------------------------------------------------------


def test_json_has_the_same_numbers():
    document = json.loads(texts("json")[""])
    assert document["order"] == "rotation first"
    for pair, found in enumerate(document["measurements"]):
        assert (found["reference"], found["source"]) == (pair, pair + 1)
        np.testing.assert_array_equal(found["covariance"], covariance(pair, FACTOR))
        np.testing.assert_array_equal(found["T_reference_source"], POSES[pair])


def test_ros_has_a_message_for_each_pair():
    messages = list(yaml.safe_load_all(texts("ros")[""]))
    assert [message["header"]["frame_id"] for message in messages] == ["scan_0", "scan_1", "scan_2"]
    for pair, message in enumerate(messages):
        pose = message["pose"]["pose"]
        assert [pose["position"][axis] for axis in "xyz"] == POSES[pair][:3, 3].tolist()
        assert set(pose["orientation"]) == set("xyzw")
        found = np.array(message["pose"]["covariance"])
        assert found.shape == (36,) and found.dtype == float
        R = POSES[pair][:3, :3]
        of_translation = R @ covariance(pair, FACTOR)[3:, 3:] @ R.T
        np.testing.assert_allclose(found.reshape(6, 6)[:3, :3], of_translation, rtol=1e-9)


def test_a_noise_model_has_a_row_for_each_coalition():
    lines = texts("markdown", measurements(table()))[""].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:6]]
    assert [row[0] for row in rows] == [
        "none",
        "initial pose scale s = 1.5",
        "sensor noise σ = 0.02 m",
        "sensor noise σ = 0.02 m, initial pose scale s = 1.5",
    ]
    assert {row[1] for row in rows} == {"3"}
    mean = np.mean([covariance(pair) for pair in range(3)], axis=0)
    for row, factor in zip(rows, (1, 2, 2, 4), strict=True):
        sigmas = json.loads(row[4].strip("`"))
        np.testing.assert_allclose(sigmas, np.sqrt(factor * np.diagonal(mean)), rtol=1e-3)
        assert float(row[2].split()[0]) == pytest.approx(np.rad2deg(sigmas[0]), rel=0.05)
        assert float(row[3].split()[0]) == pytest.approx(100 * sigmas[3], rel=0.05)


def test_the_csv_has_the_whole_covariances(tmp_path):
    path = tmp_path / "noise.csv"
    path.write_text(texts("csv", measurements(table()))[""])
    found = pd.read_csv(path)
    assert list(found["sensor_noise"]) == [0, 0, 0.02, 0.02]
    mean = np.mean([covariance(pair) for pair in range(3)], axis=0)
    assert found["covariance_03"].iloc[3] == pytest.approx(4 * mean[0, 3], rel=1e-12)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_says_what_it_is_and_writes_the_same_again(name):
    assert FORMATS[name].meaning
    assert texts(name, drive()) == texts(name, drive())
    assert all(text.endswith("\n") for text in texts(name).values())
