"""What is diagnosed in several jobs is, joined, what one job would find, to the byte."""

import logging
import sys
from contextlib import chdir
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from conftest import REPOSITORY

from benchmarks.faults.in_process import merged, script
from icpshap import config as configuration
from icpshap import plan, tables
from icpshap.jobs import paths, progress, start
from icpshap.jobs.paths import at
from icpshap.jobs.plans import Plans
from icpshap.tables import TableError

TINY = yaml.safe_load((REPOSITORY / "tests" / "tiny.yaml").read_text())["estimators"]["tiny"]
SCANS = 7
NAMES = {"experiment": "here", "sequence": "drive"}
TABLES = ("diagnosis", "instances")


def planner(scans=SCANS, **changes):
    """Of a sequence whose diagnosis is explained."""
    drive = {"scans": scans, "simulated": {"scene": "stairwell", "beams": 2500}}
    here = {"estimator": "tiny", "pairs": "consecutive", "sequences": ["drive"]}
    here |= {"instances": "here", "figures": []}
    changes = {"data": {"drive": drive}, "estimators": {"tiny": TINY}, **changes}
    config = merged({**changes, "experiments": {"here": here}})
    return Plans(configuration.load(config), {}, lambda name, *_: f"code of {name}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Scans, poses and overlaps of the sequence."""
    folder, plans = tmp_path_factory.mktemp("drive"), planner()
    names = {"sequence": "drive", "batch": 0}
    made = [paths.SCANS, paths.PAIRS, paths.OVERLAPS, paths.FIT_NUMBERS]
    for path in (*made, *(at(paths.OF_BATCH, table=of) for of in TABLES)):
        (folder / at(path, **NAMES)).parent.mkdir(parents=True)
    with chdir(folder):
        script("simulate_scans").simulate_scans(at(paths.SCANS, **names), plans.scans("drive", 0))
        poses = at(paths.POSES, **names)
        script("simulate_poses").simulate_poses(poses, SCANS, plans.poses("drive"))
        templates = {"pairs": paths.PAIRS, "overlaps": paths.OVERLAPS}
        templates["fit_numbers"] = paths.FIT_NUMBERS
        output = {name: at(template, **NAMES, batch=0) for name, template in templates.items()}
        script("check_pairs").check_pairs(
            SimpleNamespace(scans=[at(paths.SCANS, **names)], poses=poses),
            SimpleNamespace(**output),
            plans.checks(*NAMES.values(), 0),
            False,
            "",
            sys.stderr,
        )
    return folder


@pytest.fixture(scope="module", autouse=True)
def near():
    """A pair is held against two, so that a job of two does not know all of the sequence."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(plan, "NEIGHBOURS", 2)
        yield


@pytest.fixture(scope="module")
def log(near):
    """What the jobs' logs say."""
    handler, lines = logging.Handler(logging.INFO), []
    handler.emit = lambda record: lines.append(record.getMessage())
    logger = logging.getLogger()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(progress, "SECONDS", -1)  # each line that might be said is
        patched.setattr(logger, "level", logging.INFO)
        patched.setattr(logger, "handlers", [*logger.handlers, handler])
        yield lines


@pytest.fixture(scope="module")
def by_one(folder, log):
    """Bytes of both tables, as one job finds them."""
    return diagnosed(folder, SCANS - 1)


@pytest.fixture(scope="module")
def by_three(by_one, folder):
    """The same, found by three; their files stay."""
    return diagnosed(folder, 2)


def diagnosed(folder, size):
    """Bytes of both tables, found by jobs of so many pairs each."""
    with pytest.MonkeyPatch.context() as patched, chdir(folder):
        patched.setattr(plan, "DIAGNOSES_PER_JOB", size)
        plans = planner()
        scans = [at(paths.SCANS, sequence="drive", batch=0)]
        poses, overlaps = at(paths.POSES, sequence="drive"), [at(paths.OVERLAPS, **NAMES, batch=0)]
        read = {"scans": scans, "poses": poses, "overlaps": overlaps}
        number = len(plans.diagnosis_batches(*NAMES.values()))
        for batch in range(number):
            diagnosis, instances = (of_batch(of, batch) for of in TABLES)
            planned = plans.diagnosis_of_batch(*NAMES.values(), batch)
            script("diagnose_pairs").diagnose_pairs(SimpleNamespace(**read), diagnosis, planned)
            planned = plans.instances_of_batch(*NAMES.values(), batch)
            given = SimpleNamespace(**read, diagnosis=diagnosis)
            script("find_instances").find_instances(given, instances, planned)
        for of in TABLES:
            join(plans, of, [of_batch(of, batch) for batch in range(number)])
        return [Path(at(paths.OF_SEQUENCE, **NAMES, table=of)).read_bytes() for of in TABLES]


def of_batch(of, batch):
    return at(paths.OF_BATCH, **NAMES, table=of, batch=batch)


def join(plans, of, files):
    _, of_all = plans.of_diagnosis[of]
    digests = plans.batch_digests(*NAMES.values(), of)
    output = at(paths.OF_SEQUENCE, **NAMES, table=of)
    script("join_pairs").join_pairs(files, output, of, of_all(*NAMES.values()), digests)


def test_no_byte_depends_on_how_pairs_are_cut_into_jobs(folder, by_one, by_three):
    assert by_one == by_three
    found = tables.read(folder / at(paths.DIAGNOSIS, **NAMES), "diagnosis")
    assert list(found.reference) == list(range(SCANS - 1)) and (found.healthy_pairs == 2).all()
    assert len(tables.read(folder / at(paths.INSTANCES, **NAMES), "instances")) == SCANS - 1


def test_a_job_says_how_far_it_is(by_one, log):
    for number in range(1, SCANS):
        said = f"{number} of {SCANS - 1} pairs, "
        assert sum(line.startswith(said) for line in log) == 2  # diagnosis, and instances


def test_a_part_of_another_plan_is_not_joined(folder, by_three, monkeypatch):
    monkeypatch.setattr(plan, "DIAGNOSES_PER_JOB", 2)
    monkeypatch.chdir(folder)
    files = [of_batch("diagnosis", batch) for batch in range(3)]
    with pytest.raises(TableError, match=r"diagnosis/2\.parquet: made by another plan"):
        join(planner(), "diagnosis", files[::-1])
    with pytest.raises(TableError, match=r"diagnosis/0\.parquet: made by another plan"):
        join(planner(seed=7), "diagnosis", files)


def test_the_instances_of_another_diagnosis_are_not_found(folder, by_three, monkeypatch):
    monkeypatch.setattr(plan, "DIAGNOSES_PER_JOB", 2)
    monkeypatch.chdir(folder)
    given = SimpleNamespace(diagnosis=of_batch("diagnosis", 0))
    planned = planner().instances_of_batch(*NAMES.values(), 1)
    with pytest.raises(TableError, match=r"diagnosis/0\.parquet: made by another plan"):
        script("find_instances").find_instances(given, "instances.parquet", planned)


def test_a_run_puts_aside_the_parts_of_another_plan_and_names_those_of_none(
    folder, by_three, monkeypatch
):
    monkeypatch.setattr(plan, "DIAGNOSES_PER_JOB", 2)
    monkeypatch.chdir(folder)
    known = {path for path, *_ in start.planned_files(planner(), ["here"], ["drive"])}
    parts = {Path(of_batch(of, batch)) for of in TABLES for batch in range(3)}
    assert parts <= {Path(path) for path in known}
    assert not list(start.unplanned_files(planner(), ["here"], ["drive"]))
    monkeypatch.setattr(plan, "DIAGNOSES_PER_JOB", SCANS - 1)
    said = "\n".join(start.look(planner(), ["here"], ["drive"], puts_aside=False))
    assert "2 file(s) were made by another plan" in said and "diagnosis/0.parquet" in said
    assert "4 file(s) belong to no job of the plan" in said


@pytest.fixture
def usual(monkeypatch):
    monkeypatch.setattr(plan, "NEIGHBOURS", 16)


@pytest.mark.usefixtures("usual")
class TestLongDrive:
    def batches(self, scans):
        plans = planner(scans)
        places = plans.diagnosis_batches(*NAMES.values())
        batches = range(len(places))
        return places, [plans.diagnosis_of_batch(*NAMES.values(), batch) for batch in batches]

    def test_jobs_know_the_pairs_that_theirs_are_held_against_and_no_others(self):
        places, found = self.batches(1001)
        assert [len(of) for of in places] == [200] * 5
        assert [len(of["among"]) for of in found] == [216, 232, 232, 232, 216]
        assert found[1]["among"][0] == [184, 185] and found[1]["pairs"][0] == [200, 201]

    @pytest.mark.parametrize("scans", [401, 450, 451, 600])
    def test_scans_at_the_end_change_the_last_job_alone(self, scans):
        before, after = (self.batches(number)[1] for number in (scans, scans + 30))
        assert after[: len(before) - 1] == before[:-1]

    def test_the_whole_does_not_hang_on_how_it_is_cut(self, monkeypatch):
        before = [planner(1001).of_diagnosis[of][1](*NAMES.values()) for of in TABLES]
        monkeypatch.setattr(plan, "DIAGNOSES_PER_JOB", 50)
        assert [planner(1001).of_diagnosis[of][1](*NAMES.values()) for of in TABLES] == before
