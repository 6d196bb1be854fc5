"""What decides each file, and what is said of one that another plan made."""

import copy
import json
import os
from functools import cache
from pathlib import Path

import pytest
import yaml
from conftest import PAPER_CONFIG, REPOSITORY
from snakemake.utils import update_config

from icpshap import config as configuration
from icpshap import tables
from icpshap.errors import UserError
from icpshap.estimators import Estimator
from icpshap.jobs import paths, plans, start
from icpshap.jobs.paths import at
from icpshap.jobs.plans import Plans, digest

TINY = yaml.safe_load((REPOSITORY / "tests" / "tiny.yaml").read_text())
GRID, ROOM = "tiny_grid", "tiny_room"


def loaded(change=lambda config: None):
    config = copy.deepcopy(PAPER_CONFIG)
    update_config(config, copy.deepcopy(TINY))
    change(config)
    return configuration.load(config)


def plans_of(change=lambda config: None, files=None):
    return Plans(loaded(change), files or {}, cache(lambda script, *plugins: f"code of {script}"))


def jobs(planner, experiment=GRID, sequence=ROOM):
    return [
        digest(planner.job(experiment, sequence, k))
        for k in range(len(planner.jobs(experiment, sequence)))
    ]


def estimator(**values):
    return lambda config: config["estimators"]["tiny"].update(values)


class TestWhatDecides:
    """A plan changes with all that decides a file's numbers, and with nothing else."""

    @pytest.mark.parametrize(
        "change",
        [
            lambda config: config.update(seed=1),
            estimator(minimum_range=1.5),
            estimator(reference_noise_additions=2),
            lambda config: config["perturbation"].update(overlap_distance=0.3),
            lambda config: config["perturbation"].update(initial_pose_rotation=5),
            lambda config: config["data"][ROOM]["simulated"].update(beams=4000),
        ],
    )
    def test_runs(self, change):
        assert not set(jobs(plans_of())) & set(jobs(plans_of(change)))

    @pytest.mark.parametrize(
        "change",
        [
            estimator(divergence="symmetric_kl", wrong_basin_translation=0.3),
            estimator(covariance_floor_rotation=1e-5, interval="bootstrap"),
            lambda config: config["perturbation"].update(minimum_overlap=0.3),
            lambda config: config["data"][ROOM].update(scans=4, title="Another"),
            lambda config: config["experiments"][GRID].update(figures=["summary"]),
        ],
    )
    def test_but_not_how_they_are_read(self, change):
        assert jobs(plans_of()) == jobs(plans_of(change))

    def test_more_scans_add_jobs_and_change_none_but_the_last(self):
        before, after = (
            jobs(
                plans_of(lambda config, n=n: config["data"]["tiny_stairs"].update(scans=n)),
                "tiny_fixed",
                "tiny_stairs",
            )
            for n in (4, 6)
        )
        assert len(after) > len(before)
        assert after[: len(before) - 1] == before[:-1]

    def test_an_explanation_knows_method_runs_and_pairs(self):
        plain = digest(plans_of().explanation(GRID, ROOM))
        for change in (
            estimator(divergence="symmetric_kl"),
            estimator(maximum_iterations=7),
            lambda config: config["perturbation"].update(minimum_overlap=0.3),
        ):
            assert digest(plans_of(change).explanation(GRID, ROOM)) != plain

    def test_how_jobs_are_cut_is_no_part_of_an_explanation(self):
        other = plans_of(lambda config: config.update(runs_per_job=10_000))
        assert len(jobs(other)) != len(jobs(plans_of()))
        assert other.explanation(GRID, ROOM) == plans_of().explanation(GRID, ROOM)

    def test_code_and_versions_are_part_of_it(self, monkeypatch):
        planner = plans_of()
        before = jobs(planner)
        monkeypatch.setattr(plans, "versions", lambda: {"numpy": "9.9"})
        assert not set(before) & set(jobs(plans_of()))
        assert planner.job(GRID, ROOM, 0)["code"] == "code of run_icp"
        monkeypatch.undo()
        assert set(plans.versions()) == {*plans.COMPUTING, "machine"}


class TestVariants:
    """An option that makes a variant of a cause is in a plan only where it does."""

    def plan_words(self, change=lambda config: None):
        planner = plans_of(change)
        plan = [
            planner.scan(ROOM, 0),
            planner.checks(GRID, ROOM, 0),
            planner.job(GRID, ROOM, 0),
            planner.explanation(GRID, ROOM),
            planner.joined(GRID),
        ]
        return [json.dumps(part) for part in plan]

    def test_the_usual_ones_leave_no_trace(self):
        """So that what was registered before the options existed still holds."""
        for part in self.plan_words():
            for word in ("sensor", "overlap_shape", "scan_order", "variants", "time"):
                assert f'"{word}"' not in part

    def test_a_variant_is_in_whatever_it_decides(self):
        words = self.plan_words(estimator(overlap_shape="sector", sensor="velodyne_vlp_16"))
        for part in words[1:3]:
            assert '"overlap_shape": "sector"' in part and '"sensor": "velodyne_vlp_16"' in part
        for part in words[2:]:
            assert '"variants": {"sensor_noise": {"sensor": "velodyne_vlp_16"}' in part

    def test_it_comes_back_from_the_plan(self):
        planner = plans_of(estimator(overlap_shape="sector"))
        found = Estimator.decided(planner.job(GRID, ROOM, 0)["estimator"])
        assert found.causes["partial_overlap"].overlap_shape == "sector"
        assert found.causes["sensor_noise"].sensor == "none"

    def test_the_name_of_a_time_column_decides_a_scan(self):
        def own(time):
            def change(config):
                config["data"]["own"] = {"scans": 2, "archive": {"url": "https://x"}, **time}

            return digest(plans_of(change).scan("own", 0))

        assert own({"time": "t"}) != own({"time": "stamp"}) != own({})


class TestBatches:
    """Scans are read and pairs are checked by the hundred, and only what a job holds decides it."""

    def planner(self, scans, folder):
        files = [folder / f"{index}.csv" for index in range(scans)]

        def own(config):
            config["data"]["own"] = {"scans": scans, "folder": {"path": str(folder)}}
            config["experiments"]["tiny_fixed"]["sequences"] = ["own"]

        return plans_of(own, {"own": (files, folder / "poses.txt")})

    def digests(self, planner):
        batches = range(len(planner.scan_batches("own")))
        scans = [digest(planner.scans("own", batch)) for batch in batches]
        return scans, planner.check_digests("tiny_fixed", "own"), jobs(planner, "tiny_fixed", "own")

    def test_scans_at_the_end_change_the_last(self, tmp_path):
        before, after = (self.digests(self.planner(scans, tmp_path)) for scans in (250, 330))
        for were, are in zip(before, after, strict=True):
            assert len(are) > len(were) > 2
            assert are[: len(were) - 1] == were[:-1]

    def test_an_edited_scan_changes_those_that_hold_it(self, tmp_path):
        before = self.digests(self.planner(250, tmp_path))
        (tmp_path / "120.csv").touch()
        after = self.digests(self.planner(250, tmp_path))
        changed = [
            [number for number, (a, b) in enumerate(zip(*both, strict=True)) if a != b]
            for both in zip(before, after, strict=True)
        ]
        assert changed[:2] == [[1], [1]] and 1 <= len(changed[2]) <= 4

    def test_each_scan_of_an_archive_is_fetched_by_itself(self):
        def remote(config):
            config["data"]["own"] = {"scans": 250, "archive": {"url": "https://x"}}

        planner = plans_of(remote)
        assert len(planner.scan_batches("own")) == 250
        assert planner.scans("own", 7) == planner.scan("own", 7)


class TestSelection:
    """Of a long drive only scans of a pair are read, and more pairs are added at the end."""

    def planner(self, pairs):
        def change(config):
            street = {"scans": 1000, "simulated": {"scene": "street", "beams": 3000}}
            config["data"]["street"] = street
            config["experiments"]["tiny_fixed"] |= {"sequences": ["street"], "pairs": pairs}

        return plans_of(change)

    def test_only_scans_of_a_pair_are_read(self):
        planner = self.planner({"every": 50, "count": 6})
        found = planner.scan_batches("street")
        assert [planner.file_of_scan("street", index) for index in (99, 100, 999)] == [0, 1, 9]
        assert found[:3] == [[k, k + 1, k + 50, k + 51] for k in (0, 100, 200)]
        assert planner.scans("street", 1)["scans"] == [100, 101, 150, 151]

    def test_of_all_pairs_every_scan_is(self):
        found = self.planner("consecutive").scan_batches("street")
        assert [index for batch in found for index in batch] == list(range(1000))

    def test_where_poses_are_registered_every_scan_is(self, tmp_path):
        def change(config):
            folder = {"path": str(tmp_path), "poses": "register"}
            config["data"]["own"] = {"scans": 300, "folder": folder}
            config["experiments"]["tiny_fixed"] |= {"sequences": ["own"], "pairs": {"every": 50}}

        assert [len(batch) for batch in plans_of(change).scan_batches("own")] == [100, 100, 100]

    def test_more_pairs_change_the_last_job_and_no_file_of_scans_before_it(self):
        few, more = (self.planner({"every": 50, "count": count}) for count in (5, 8))
        were, are = (planner.job_digests("tiny_fixed", "street") for planner in (few, more))
        assert len(are) > len(were) > 1 and are[: len(were) - 1] == were[:-1]
        assert few.scans("street", 0) == more.scans("street", 0)
        assert few.scans("street", 2) != more.scans("street", 2)


class TestHere:
    """What is diagnosed decides what is run, where it is explained, and nothing elsewhere."""

    NAME, SEQUENCE = "tiny_fixed", "tiny_stairs"

    def planner(self, more=lambda config: None):
        def change(config):
            config["data"][self.SEQUENCE]["scans"] = 4
            config["experiments"][self.NAME] |= {"instances": "here", "figures": []}
            config["experiments"][self.NAME]["sequences"] = [self.SEQUENCE]
            more(config)

        return plans_of(change)

    def test_jobs_are_cut_before_there_is_a_diagnosis(self):
        planner = self.planner()
        jobs = planner.jobs(self.NAME, self.SEQUENCE)
        assert sum(part.stop - part.start for job in jobs for part in job) == 3 * (2**3 + 1)

    @pytest.mark.parametrize(
        "change",
        [
            # Of other scans of the sequence, which a pair is diagnosed beside.
            lambda config: config["data"]["tiny_stairs"].update(scans=5),
            lambda config: config["perturbation"].update(minimum_overlap=0.3),
        ],
    )
    def test_another_diagnosis_runs_all_again(self, change):
        before, after = (
            jobs(planner, self.NAME, self.SEQUENCE)
            for planner in (self.planner(), self.planner(change))
        )
        assert not set(before) & set(after)

    def test_the_plan_of_all_names_the_same_instances(self):
        planner = self.planner()
        instances = digest(planner.instances(self.NAME, self.SEQUENCE))
        made = planner.instances_of_batch(self.NAME, self.SEQUENCE, 0)
        assert made["diagnosis"] == digest(planner.diagnosis_of_batch(self.NAME, self.SEQUENCE, 0))
        for plan in (
            planner.job(self.NAME, self.SEQUENCE, 0),
            planner.explanation(self.NAME, self.SEQUENCE),
        ):
            assert plan["instances"] == instances
            assert plan["variants"] == {"partial_overlap": {"overlap_shape": "sector"}}

    def test_others_know_nothing_of_it(self):
        planner = plans_of()
        for plan in (planner.job(GRID, ROOM, 0), planner.explanation(GRID, ROOM)):
            assert "instances" not in plan and "measured" not in plan


class TestTraining:
    """What an estimator learns from decides its numbers: other sequences, and not its own."""

    def planner(self, more=lambda config: None):
        def change(config):
            config["estimators"]["mine"] = {"kind": "learned", "training": "tiny_fixed"}
            config["experiments"]["again"] = {"based_on": "tiny_fixed", "estimator": "mine"}
            config["data"][ROOM]["scans"] = config["data"]["tiny_stairs"]["scans"] = 31
            config["run"] = ["tiny_fixed", "again"]
            more(config)

        return plans_of(change)

    def test_one_sequence_is_left_out(self):
        planner = self.planner()
        assert planner.training("again") == "tiny_fixed"
        assert planner.training_sequences("again", ROOM) == ["tiny_stairs"]
        learned_from = planner.descriptors("tiny_fixed", "tiny_stairs")
        expected = [["tiny_stairs", digest(learned_from)]]
        assert planner.job("again", ROOM, 0)["training"] == expected

    def test_others_learn_from_none(self):
        planner = self.planner()
        assert planner.training("tiny_fixed") is None
        assert planner.training_sequences("tiny_fixed", ROOM) == []
        assert "training" not in planner.job("tiny_fixed", ROOM, 0)

    @pytest.mark.parametrize(
        "change",
        [
            estimator(maximum_iterations=7),
            estimator(covariance_floor_rotation=1e-5),
            lambda config: config["data"]["tiny_stairs"].update(scans=32),
        ],
    )
    def test_what_decides_that_decides_the_estimates(self, change):
        before, after = self.planner(), self.planner(change)
        assert not set(jobs(before, "again", ROOM)) & set(jobs(after, "again", ROOM))

    def test_its_own_sequence_does_not(self):
        def beams(config):
            config["data"][ROOM]["simulated"]["beams"] = 4000

        before, after = self.planner(), self.planner(beams)
        plans_before, plans_after = (p.job("again", ROOM, 0) for p in (before, after))
        assert plans_before["training"] == plans_after["training"]
        assert not set(jobs(before, "again", "tiny_stairs")) & set(
            jobs(after, "again", "tiny_stairs")
        )


class TestOutsideFiles:
    """A file from outside enters by size and time stamp; an older date is another stamp."""

    @pytest.fixture
    def scan(self, tmp_path):
        path = tmp_path / "s0.csv"
        path.write_text("x,y,z\n1,2,3\n")
        return path

    def planned(self, scan):
        def own(config):
            config["data"]["own"] = {"scans": 2, "folder": {"path": str(scan.parent)}}

        return digest(plans_of(own, {"own": ([scan, scan], scan)}).scan("own", 0))

    def test_an_older_file_of_the_same_size_is_another(self, scan):
        before = self.planned(scan)
        assert self.planned(scan) == before
        os.utime(scan, (1e9, 1e9))
        assert self.planned(scan) != before

    def test_another_size_at_the_same_time_is_another(self, scan):
        status = scan.stat()
        before = self.planned(scan)
        scan.write_text("x,y,z\n1,2,33\n")
        os.utime(scan, ns=(status.st_atime_ns, status.st_mtime_ns))
        assert self.planned(scan) != before

    def test_a_file_that_is_not_there_has_a_stamp_too(self, tmp_path):
        assert plans.stamp(tmp_path / "nothing")["size"] is None


class TestRegisteredPoses:
    """Where ICP makes the poses, what it registers decides them, and nothing else does."""

    def planner(self, folder, scans=4, **options):
        files = [folder / f"{index}.csv" for index in range(scans)]

        def own(config):
            options_of_folder = {"path": str(folder), "poses": "register", **options}
            config["data"]["own"] = {"scans": scans, "folder": options_of_folder}

        return plans_of(own, {"own": (files, None)})

    def test_more_scans_leave_the_pairs_that_were_there(self, tmp_path):
        before, after = self.planner(tmp_path), self.planner(tmp_path, 5)
        assert before.overlap("own", (1, 3)) == after.overlap("own", (1, 3))
        assert digest(before.poses("own")) != digest(after.poses("own"))

    def test_a_scan_decides_the_pairs_that_are_chained_over_it(self, tmp_path):
        before = self.planner(tmp_path)
        found = {pair: before.overlap("own", pair) for pair in ((0, 1), (1, 3), (3, 1))}
        (tmp_path / "2.csv").touch()
        after = self.planner(tmp_path)
        assert after.overlap("own", (0, 1)) == found[0, 1]
        assert after.overlap("own", (1, 3)) != found[1, 3]
        assert after.overlap("own", (3, 1)) != found[3, 1]

    def test_where_icp_starts(self, tmp_path):
        guess = [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0]
        files = (self.planner(tmp_path, guess="guess.txt"), self.planner(tmp_path, guess=guess))
        plans_found = {digest(planner.registration("own", 0)) for planner in files}
        plans_found.add(digest(self.planner(tmp_path).registration("own", 0)))
        (tmp_path / "guess.txt").touch()
        plans_found.add(digest(files[0].registration("own", 0)))
        assert len(plans_found) == 4


def write(path, table, plan, **about):
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    causes = plan.get("levels", {}) if table in tables.WITH_CAUSES else ()
    tables.write(path, tables.empty(table, causes), table, plan, causes, **about)


@pytest.fixture
def there(tmp_path, monkeypatch):
    """The files of the tiny grid as a run leaves them, without rows."""
    monkeypatch.chdir(tmp_path)
    planner = plans_of()
    names = {"experiment": GRID, "sequence": ROOM}
    pair = at(paths.PAIRS, **names, batch=0)
    data = {"scan_0": "a", "scan_1": "b"}
    write(pair, "pairs", planner.checks(GRID, ROOM, 0), data=data)
    runs = [at(paths.RUNS, **names, job=k) for k in range(len(planner.jobs(GRID, ROOM)))]
    for k, path in enumerate(runs):
        write(path, "runs", planner.job(GRID, ROOM, k), data=data, registered=[(0, 1)])
    return planner, pair, runs


class TestReader:
    """Who reads runs refuses those of another plan or of other data."""

    def check(self, planner, runs, pair):
        planned, jobs = planner.explanation(GRID, ROOM), planner.job_digests(GRID, ROOM)
        plans.check_estimates(runs, jobs, planned, [pair])

    def test_right_ones_pass(self, there):
        planner, pair, runs = there
        self.check(planner, runs, pair)

    def test_swapped_files_are_refused(self, there):
        planner, pair, runs = there
        with pytest.raises(tables.TableError, match=r"1.parquet: made by another plan .*\nHint"):
            self.check(planner, runs[::-1], pair)

    def test_runs_of_another_seed_are_named_with_their_seed(self, there):
        planner, pair, runs = there
        other = plans_of(lambda config: config.update(seed=7))
        write(runs[1], "runs", other.job(GRID, ROOM, 1), data={}, registered=[])
        with pytest.raises(tables.TableError, match=r"\(seed 7, planned 42\)"):
            self.check(planner, runs, pair)

    def test_runs_of_other_data_are_refused(self, there):
        planner, pair, runs = there
        data = {"scan_0": "a", "scan_1": "old"}
        write(runs[0], "runs", planner.job(GRID, ROOM, 0), data=data, registered=[(0, 1)])
        with pytest.raises(tables.TableError, match=r"0.parquet: made from another scan_1 "):
            self.check(planner, runs, pair)

    def test_a_table_of_another_plan_is_refused(self, there):
        planner, pair, _ = there
        plans.check(pair, *planner.check_digests(GRID, ROOM))
        with pytest.raises(tables.TableError, match=r"0.parquet: made by another plan.\nHint"):
            plans.check(pair, "something else")


class TestStart:
    """What lies in results/ when a run begins."""

    def look(self, planner):
        return start.look(planner, [GRID], [ROOM])

    def test_what_belongs_is_left_alone(self, there):
        planner, _, runs = there
        before = os.stat(runs[0]).st_mtime_ns
        assert self.look(planner) == []
        assert os.stat(runs[0]).st_mtime_ns == before

    def test_what_another_plan_made_is_put_aside_and_said(self, there):
        planner, _, runs = there
        other = plans_of(lambda config: config.update(seed=7))
        write(runs[1], "runs", other.job(GRID, ROOM, 1), data={}, registered=[])
        (line,) = self.look(planner)
        assert line.startswith(
            "1 file(s) were made by another plan. They are kept as *.stale, and made again where "
            "they are needed; the first is results/tiny_grid/tiny_room/runs/1.parquet ("
        )
        assert line.endswith("; seed 7, planned 42).")
        assert Path(runs[0]).exists() and not Path(runs[1]).exists()
        assert Path(f"{runs[1]}.stale").exists()

    def test_what_follows_from_it_is_put_aside_with_it(self, there):
        """Else the workflow would have nothing to do: the last files are all there."""
        planner, _, runs = there
        names = {"experiment": GRID, "table": "shap"}
        tables_ = [at(paths.OF_SEQUENCE, sequence=ROOM, **names), at(paths.OF_EXPERIMENT, **names)]
        write(tables_[0], "shap", planner.explanation(GRID, ROOM))
        write(tables_[1], "shap", planner.joined(GRID) | {"levels": {}})
        Path(runs[0]).write_bytes(b"")
        self.look(planner)
        assert not [path for path in tables_ if Path(path).exists()]

    def test_who_only_looks_changes_nothing(self, there):
        planner, _, runs = there
        Path(runs[0]).write_bytes(b"")
        assert len(start.look(planner, [GRID], [ROOM], puts_aside=False)) == 1
        assert Path(runs[0]).exists()

    @pytest.mark.parametrize(
        ("command", "expected"),
        [
            ("-j2", True),
            ("-j 2 --configfile config/demo.yaml --config seed=1 -- results/x/shap.parquet", True),
            ("--cores all --forcerun run_icp -k", True),
            ("-call -p --printshellcmds", True),
            ("-n", False),
            ("-j2 -np", False),
            ("-j2 --dry-run", False),
            ("--lint", False),
            ("--unlock", False),
            ("--report report.zip", False),
            ("-j2 --touch", False),
        ],
    )
    def test_only_a_run_makes_files(self, command, expected):
        assert start.is_run(command.split()) == expected

    def test_a_table_in_the_place_of_another_of_the_same_plan(self, there):
        planner, *_ = there
        shap = at(paths.OF_SEQUENCE, experiment=GRID, sequence=ROOM, table="shap")
        write(shap, "uncertainty", planner.explanation(GRID, ROOM))
        (line,) = self.look(planner)
        assert "shap.parquet (it is a table of uncertainty)" in line

    def test_what_cannot_be_read_is_made_again(self, there):
        planner, _, runs = there
        Path(runs[0]).write_bytes(b"")
        (line,) = self.look(planner)
        assert "runs/0.parquet (it cannot be read)" in line

    def test_a_pair_that_is_registered_now_was_not_when_its_job_ran(self, there):
        planner, _, runs = there
        write(runs[0], "runs", planner.job(GRID, ROOM, 0), data={}, registered=[])
        overlaps = at(paths.OVERLAPS, experiment=GRID, sequence=ROOM, batch=0)
        Path(overlaps).parent.mkdir()
        tables.write_overlaps(overlaps, [((0, 1), [True], 0.8)], planner.checks(GRID, ROOM, 0))
        (line,) = self.look(planner)
        assert "runs/0.parquet (pair 0-1 is registered now, and was not)" in line

    def test_what_no_job_makes_is_named_and_not_touched(self, there):
        planner, _, runs = there
        stranger = Path(runs[0]).with_name("99.parquet")
        stranger.write_bytes(b"old")
        (line,) = self.look(planner)
        assert "1 file(s) belong to no job of the plan and are not read" in line
        assert "runs/99.parquet" in line and stranger.read_bytes() == b"old"


class TestFoldersOfTheWorkflow:
    def test_missing_and_usual_ones_are_fine(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "results").mkdir()
        start.check_folders()

    def test_a_file_in_the_place_of_one(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "logs").write_text("a file")
        with pytest.raises(UserError, match=r"logs: is a file.*\nHint: move it away"):
            start.check_folders()

    def test_one_that_cannot_be_written_to(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "results").mkdir()
        # Root may write to any folder, so that no mode would do.
        monkeypatch.setattr(start.os, "access", lambda path, mode: str(path) != "results")
        with pytest.raises(UserError, match=r"results: the folder cannot be written to.*\nHint:"):
            start.check_folders()


def test_two_plans_are_set_against_each_other_in_words():
    found, planned = {"seed": 1, "levels": {"a": [1]}}, {"seed": 2, "levels": {"a": [1]}}
    assert plans.difference(found, planned) == "seed 1, planned 2"
    assert plans.difference({}, {"code": "x" * 99}).endswith("...")
