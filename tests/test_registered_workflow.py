"""Folders of scans without poses: ICP makes them, and the results say so."""

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import folder_in
from known_files import written
from project import TINY, Project

from icpshap import se3, tables
from icpshap.data.poses import read_poses

T_BETWEEN = se3.exp([[0.02, -0.01, 0.08, 0.3, -0.1, 0.05], [0.0, 0.02, -0.1, 0.25, 0.1, 0.0]])
POSES = np.stack([np.eye(4), T_BETWEEN[0], T_BETWEEN[0] @ T_BETWEEN[1]])


def corner(generator, count=6000):
    """Points of the corner of a room, with boxes in it."""
    points = generator.uniform([-4, -3, -1.2], [5.0, 4.0, 1.8], (count, 3))
    wall = generator.integers(0, 3, count)
    points[np.arange(count), wall] = np.array([5.0, 4.0, -1.2])[wall]
    return points + generator.normal(0, 0.005, points.shape)


def write_scans(folder, number=3):
    """Binary rows of x, y, z and intensity, each seen from its own place."""
    folder.mkdir(parents=True)
    generator = np.random.default_rng(5)
    for index in range(number):
        points = se3.transform(se3.inverse(POSES[index]), corner(generator))
        rows = np.column_stack([points, np.ones(len(points))]).astype("<f4")
        (folder / f"{index:06}.bin").write_bytes(rows.tobytes())


def configuration(scans=3, **folder):
    config = yaml.safe_load(TINY.read_text(encoding="utf-8"))
    config["data"] = {
        "own": {"title": "Own", "scans": scans, "folder": {"path": "drive", **folder}}
    }
    fixed = config["experiments"]["tiny_fixed"] | {"sequences": ["own"], "figures": []}
    config["experiments"] = {"tiny_fixed": fixed}
    return {**config, "sequences": ["own"], "run": ["tiny_fixed"]}


def project_of(folder, **options):
    project = Project(folder)
    written(folder / "tiny.yaml", yaml.safe_dump(configuration(**options)))
    return project


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A project whose scans, in a subfolder, were registered and explained."""
    project = project_of(tmp_path_factory.mktemp("registered"), poses="register")
    write_scans(project.folder / "drive" / "velodyne")
    project.said = project.tiny()
    return project


def resource(project, name):
    return project.folder / "resources" / "own" / f"{name}.parquet"


@pytest.mark.slow
class TestFinished:
    def test_the_poses_are_icp_s_answers(self, finished):
        poses = tables.read_poses(resource(finished, "poses"))
        errors = se3.log(se3.inverse(poses) @ POSES)
        assert np.abs(errors[:, :3]).max() < np.deg2rad(0.1)
        assert np.abs(errors[:, 3:]).max() < 0.01
        (first,) = (
            tables.read(resource(finished, "registered/0"), "registrations").iloc[:1].itertuples()
        )
        assert first.overlap > 0.8 and first.rmse < 0.02

    def test_everything_says_whose_answers_they_are(self, finished):
        said = "the true pose is what ICP itself answered (`poses: register`)"
        assert tables.read_about(resource(finished, "poses"))["truth"].startswith(said)
        assert finished.said.count(said) == 1
        pairs = pd.read_parquet(finished.folder / "results/tiny_fixed/own/pairs.parquet")
        assert pairs["warning"].str.contains("a bias that ICP has on these scans is hidden").all()
        report = (finished.folder / "results/report.html").read_text(encoding="utf-8")
        assert "a bias that ICP has on these scans is hidden" in report

    def test_the_scans_are_explained(self, finished):
        shap = pd.read_parquet(finished.folder / "results/tiny_fixed/shap.parquet")
        assert len(shap) == 2 and np.isfinite(shap["f"]).all()

    def test_a_second_run_has_nothing_to_do(self, finished):
        assert "Nothing to be done" in finished.tiny()

    def test_a_guess_registers_again_and_what_follows(self, finished, tmp_path):
        guess = [1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, 0]
        config = configuration(poses="register", guess=guess)
        path = written(tmp_path / "guess.yaml", yaml.safe_dump(config))
        planned = finished.planned("--configfile", str(path))
        assert planned["register_pairs"] == planned["check_pairs"] == 1
        assert "read_scans" not in planned and planned["run_icp"] >= 1


def test_a_dry_run_before_anything_was_read(tmp_path):
    project = project_of(tmp_path, poses="register")
    write_scans(tmp_path / "drive")
    planned = project.planned("--configfile", "tiny.yaml")
    assert (planned["register_pairs"], planned["register_poses"], planned["read_scans"]) == (
        1,
        1,
        1,
    )
    assert "read_poses" not in planned


def test_a_pair_that_does_not_register_is_named(tmp_path):
    project = project_of(tmp_path, poses="register", scans=2)
    write_scans(tmp_path / "drive", 2)
    generator = np.random.default_rng(0)
    rows = np.column_stack([generator.uniform(-40, 40, (4000, 3)), np.ones(4000)])
    (tmp_path / "drive/000001.bin").write_bytes(rows.astype("<f4").tobytes())
    said = project.tiny("--", "resources/own/poses.parquet", fails=True)
    assert "own, scans 0 and 1: did not register: " in said
    assert "Traceback" not in said and "let ICP start nearer to the answer" in said


@pytest.mark.slow
def test_a_file_of_guesses(tmp_path):
    project = project_of(tmp_path, poses="register", guess="guess.txt")
    write_scans(tmp_path / "drive")
    rows = [" ".join(map(repr, T[:3].ravel().tolist())) for T in T_BETWEEN]
    guess = written(tmp_path / "drive" / "guess.txt", "\n".join(rows))
    project.tiny("--", "resources/own/poses.parquet")
    errors = se3.log(se3.inverse(tables.read_poses(resource(project, "poses"))) @ POSES)
    assert np.abs(errors).max() < 0.01
    written(guess, "\n".join([*rows, rows[0]]))
    said = project.tiny("--", "resources/own/poses.parquet", fails=True)
    assert "guess.txt: 3 transforms, expected 1 or 2" in said


def test_poses_of_a_longer_drive(tmp_path):
    """Scans 1 and 2 of a drive, whose poses are those of all."""
    project = project_of(tmp_path, scans=2)
    write_scans(tmp_path / "drive" / "velodyne")
    (tmp_path / "drive/velodyne/000000.bin").unlink()
    rows = "\n".join(" ".join(map(repr, T[:3].ravel().tolist())) for T in POSES)
    path = written(tmp_path / "drive" / "poses.txt", rows)
    project.tiny("--", "resources/own/poses.parquet")
    found = tables.read_poses(resource(project, "poses"))
    np.testing.assert_array_equal(found, read_poses(path, 3)[1:])


def test_the_order_of_quaternions_is_asked_of_the_scans(tmp_path):
    from scipy.spatial.transform import Rotation

    project = project_of(tmp_path)
    write_scans(tmp_path / "drive")
    quaternions = Rotation.from_matrix(POSES[:, :3, :3]).as_quat(scalar_first=True)
    rows = np.column_stack([np.arange(3), POSES[:, :3, 3], quaternions])
    np.savetxt(tmp_path / "drive" / "poses.tum", rows, fmt="%.9f")
    project.tiny("--", "resources/own/poses.parquet")
    np.testing.assert_allclose(tables.read_poses(resource(project, "poses")), POSES, atol=1e-6)


@pytest.mark.parametrize("name", ["apartment_pair", "spinning_pair"])
def test_real_scans_come_out_where_they_were(name):
    from icpshap.data.folder import find_folder_files
    from icpshap.data.registering import register_scans
    from icpshap.data.scans import read_scan

    paths, pose_path = find_folder_files(folder_in("ICPSHAP_REAL_DATA") / name, 2)
    poses = read_poses(pose_path, 2)
    scans = [read_scan(path)[0] for path in paths]
    found = register_scans(*scans, np.eye(4), name)
    error = se3.log(se3.inverse(found.T_reference_source) @ se3.inverse(poses[0]) @ poses[1])
    assert np.linalg.norm(error[3:]) < 0.02 and np.linalg.norm(error[:3]) < np.deg2rad(0.5)
