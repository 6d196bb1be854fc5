"""A drive that is looked at while it runs: what is finished is as it will be in the end."""

import pandas as pd
import pytest
from project import Project

from icpshap.jobs import start
from icpshap.tables import PAIR

DRIVE = """\
sequences: [street]
run: [along]
data:
  street:
    title: Street
    scans: 9
    simulated: {scene: stairwell, beams: 3000}
experiments:
  along:
    based_on: tiny_fixed
    sequences: [street]
    pairs: {step: 2, count: 6}
    instances:
      fixed: {sensor_noise: 0.05, initial_pose: 1.5}
    figures: [pairs, drive]
"""
pytestmark = pytest.mark.slow
GIVEN = ("--configfile", "tiny.yaml", "drive.yaml")
DONE = (0, 1, 2, 4, 5)  # jobs, of one pair each
OWN = "results/so_far/along/street"


class Drive(Project):
    """A run of six pairs that was stopped when all but one were finished, and then looked at."""

    def __init__(self, folder):
        super().__init__(folder)
        (folder / "drive.yaml").write_text(DRIVE)
        runs = [f"results/along/street/runs/{job}.parquet" for job in DONE]
        self.run(*runs, *GIVEN)
        self.before = self.digests("results/**/*.parquet")
        self.said = self.run("so_far", "--nolock", *GIVEN)
        self.after = self.digests("results/along/**/*.parquet")
        self.partial = {table: self.table(OWN, table) for table in start.OF_EXPLANATION}

    def table(self, folder, table):
        return pd.read_parquet(self.folder / folder / f"{table}.parquet")

    def text(self, path):
        return (self.folder / path).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return Drive(tmp_path_factory.mktemp("drive"))


def test_it_says_how_much_is_finished(drive):
    assert "along/street: 5 of 6 pairs" in drive.said
    for path in ("results/so_far/report.html", f"{OWN}/figures/drive.txt"):
        assert "Partial" in drive.text(path) and "along/street: 5 of 6 pairs" in drive.text(path)
    assert list(drive.partial["pairs"].reference) == list(DONE)
    assert len(drive.text(f"{OWN}/figures/drive.csv").splitlines()) == 1 + 2


def test_nothing_of_the_run_is_touched(drive):
    assert drive.before == drive.after


def test_it_is_made_again_only_when_more_is_finished(drive):
    assert "Nothing to be done" in drive.run("so_far", "--nolock", *GIVEN)


def test_it_leaves_the_lock_of_the_run_alone(drive):
    for target in ("so_far", "results/so_far"):
        said = drive.run(target, *GIVEN, fails=True)
        assert "so_far: expected --nolock too" in said


def test_a_run_that_only_names_it_is_a_run(drive):
    """Such as looks at what is there, and has a lock."""
    planned = drive.planned("--forcerun", "so_far", *GIVEN)
    assert planned["run_icp"] == 1


def test_its_numbers_are_those_of_the_end(drive):
    drive.run(*GIVEN)
    for table, partial in drive.partial.items():
        final = drive.table("results/along/street", table)
        assert len(final) > len(partial) > 0
        rows = final.merge(partial[PAIR].drop_duplicates(), on=PAIR)[list(final)]
        pd.testing.assert_frame_equal(partial, rows, check_exact=True)
    assert "Partial" not in drive.text("results/report.html")
    assert "<td>Street " in drive.text("results/report.html")
    for kind in ("png", "svg", "txt", "csv"):
        assert (drive.folder / f"results/along/street/figures/drive.{kind}").exists()
