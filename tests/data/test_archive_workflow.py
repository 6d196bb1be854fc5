"""The whole workflow on an archive that a server on this machine serves."""

import pytest
import yaml
from misbehaving_server import MisbehavingServer, build_archive
from project import TINY, Project
from test_archive import member_bytes

from icpshap.data import remote_file, simulate


@pytest.fixture(scope="module")
def archive():
    """Two scans of an apartment, and a megabyte that nobody needs."""
    poses = simulate.simulate_poses("apartment", 2, seed=1)
    scans = [simulate.simulate_scan("apartment", k, T, 3000, seed=1) for k, T in enumerate(poses)]
    return build_archive(scans, poses, root="apartment_03-Dec-2011-18_13_33")


def configured(project, url, archive, scans=2):
    """Let the tiny experiment with fixed values run on the archive at `url` alone."""
    config = yaml.safe_load(TINY.read_text(encoding="utf-8"))
    config["sequences"], config["run"] = ["tiny_remote"], ["tiny_fixed"]
    config["data"]["tiny_remote"] = {
        "title": "Tiny remote apartment",
        "scans": scans,
        "archive": {"url": url, "bytes": len(archive)},
    }
    config["experiments"]["tiny_fixed"]["sequences"] = ["tiny_remote"]
    (project.folder / "remote.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    return "--configfile", "remote.yaml"


@pytest.mark.slow
def test_the_experiment_costs_its_members_and_the_directory(archive, tmp_path, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    project = Project(tmp_path)
    nowhere = configured(project, "https://nowhere.invalid/content", archive)
    assert project.planned(*nowhere)["fetch_scan"] == 2  # planning needs no network
    with MisbehavingServer(archive, ["drop", "busy", "truncate"]) as server:
        arguments = configured(project, server.url, archive)
        project.run(*arguments, "--", "results/tiny_fixed/shap.parquet")
        needed = member_bytes(archive, "Hokuyo_0.csv", "Hokuyo_1.csv", "leica.csv")
        # Three jobs read the directory, a block or two; a fault costs a repeated block at most.
        assert needed <= server.bytes_sent <= needed + 7 * remote_file.SMALL_BLOCK
        assert server.bytes_sent < len(archive) / 2
        assert server.most_connections <= 2
    assert (tmp_path / "results/tiny_fixed/shap.parquet").is_file()
    assert not list(tmp_path.glob("resources/tiny_remote/archive/*.part"))
    assert "Nothing to be done" in project.run(
        *arguments, "--", "results/tiny_fixed/shap.parquet"
    )  # with the server gone


def test_another_scan_count_stops_with_both_numbers(archive, tmp_path, monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    project = Project(tmp_path)
    with MisbehavingServer(archive) as server:
        said = project.run(*configured(project, server.url, archive, scans=3), fails=True)
    assert "2 scans in the archive, but the configuration says `scans: 3`" in said
    assert "change `scans: 3` to `scans: 2`" in said
    assert not list(tmp_path.glob("results/tiny_fixed/*/runs"))
