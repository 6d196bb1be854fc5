"""The whole workflow, as a user runs it, on tiny clouds."""

import logging
import shutil
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import REPOSITORY
from project import TINY, TINY_ESTIMATORS, Project, change, planned_jobs

from benchmarks.faults import in_process
from icpshap import cli
from icpshap.jobs import progress


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A project in which the tiny experiments have run, and what snakemake said."""
    project = Project(tmp_path_factory.mktemp("finished"))
    project.said = project.tiny()
    return project


@pytest.fixture
def project(tmp_path):
    return Project(tmp_path)


def test_everything_is_made(finished):
    results = finished.folder / "results"
    for experiment in ("tiny_grid", "tiny_fixed"):
        for table in ("uncertainty", "shap", "covariances", "fit"):
            assert (results / experiment / f"{table}.parquet").is_file()
    shap = pd.read_parquet(results / "tiny_grid" / "shap.parquet")
    assert len(shap) == 8
    phi = [f"phi_{name}" for name in ("sensor_noise", "initial_pose", "partial_overlap")]
    total = shap[phi].sum(axis=1) + shap["base_value"]
    assert total.to_numpy() == pytest.approx(shap["f"].to_numpy())
    assert shap["f"].iloc[-1] > 1
    fixed = pd.read_parquet(results / "tiny_fixed" / "shap.parquet")
    assert list(fixed["sequence"]) == ["tiny_room", "tiny_stairs", "tiny_stairs"]


def test_covariances_are_exported(finished, capsys):
    results = finished.folder / "results" / "tiny_fixed"
    of_all = str(results / "covariances.parquet")
    assert cli.main(["export", of_all, "--to", "g2o"]) == 1
    assert "expected one" in capsys.readouterr().err
    assert cli.main(["export", of_all, "--to", "g2o", "--sequence", "tiny_stairs"]) == 0
    said = capsys.readouterr().out
    assert said.count("EDGE_SE3:QUAT") == 2
    of_sequence = str(results / "tiny_stairs" / "covariances.parquet")
    assert cli.main(["export", of_sequence, "--to", "g2o"]) == 0
    assert capsys.readouterr().out == said


def test_how_the_settings_fit_is_said_before_any_icp_and_stands_in_one_table(finished):
    said = finished.said
    assert said.index("tiny_fixed, tiny_room: ") < said.index("] run_icp tiny_fixed tiny_room")
    fit = pd.read_parquet(finished.folder / "results" / "tiny_fixed" / "fit.parquet")
    assert set(fit["check"]) >= {
        "true pose",
        "rings",
        "points",
        "clean success",
        "clean basin",
        "stopping",
    }
    assert fit.groupby("sequence", sort=False)["check"].size().to_dict() == {
        "tiny_room": 12,
        "tiny_stairs": 24,
    }


def test_logs_are_written_where_the_rule_says(finished):
    logs = finished.folder / "logs"
    assert (logs / "run_icp" / "tiny_grid" / "tiny_room" / "0.log").is_file()
    said = (logs / "check_pairs" / "tiny_grid" / "tiny_room" / "0.log").read_text()
    assert said.startswith("overlap 0.")


def test_an_explanation_says_how_far_it_is(finished, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(progress, "SECONDS", -1)  # each line that might be said is
    caplog.set_level(logging.INFO)
    config = yaml.safe_load((finished.folder / "tiny.yaml").read_text())
    with in_process.inside(finished.folder):
        found = in_process.planner(config)
        in_process.explain(found, "tiny_fixed", "tiny_stairs", tmp_path)
    said = [record.getMessage() for record in caplog.records]
    assert [line.partition(",")[0] for line in said] == ["1 of 2 pairs", "2 of 2 pairs"]


def test_a_rule_that_the_command_line_names_makes_all_of_its_files(finished):
    targets = ("-n", "--configfile", "tiny.yaml")
    said = planned_jobs(finished.run(*targets, "--forcerun", "explain_sequence"))
    assert said["explain_sequence"] == 4 and "explain_few_settings" not in said
    said = planned_jobs(finished.run(*targets, "--forcerun", "explain_few_settings"))
    assert said["explain_few_settings"] == 4 and "explain_sequence" not in said


def test_a_second_run_has_nothing_to_do(finished):
    assert "Nothing to be done" in finished.tiny()


def test_one_sequence_and_then_all_again_registers_nothing_twice(finished):
    before = finished.digests("results/*/*/runs/*.parquet")
    stamps = {path: (finished.folder / path).stat().st_mtime_ns for path in before}
    restricted = finished.tiny("--config", "sequences=[tiny_stairs]")
    assert "run_icp" not in restricted
    assert (finished.folder / "results/tiny_fixed/tiny_stairs/shap.parquet").is_file()
    assert "Skipping tiny_grid: none of its sequences (tiny_room) is selected." in restricted
    assert "run_icp" not in finished.planned("--configfile", "tiny.yaml")
    assert {path: (finished.folder / path).stat().st_mtime_ns for path in before} == stamps


def test_forcing_one_sequence_leaves_the_others_alone(finished):
    plan = finished.run(
        "-n",
        "--configfile",
        "tiny.yaml",
        "--config",
        "sequences=[tiny_stairs]",
        "--forcerun",
        "run_icp",
    )
    assert "tiny_stairs" in plan
    assert "runs/0.parquet" in plan
    assert "tiny_room" not in plan.replace("(tiny_room)", "")


@pytest.mark.slow
def test_same_bytes_with_other_cores_and_other_chunks(finished, project):
    tables = [
        f"results/{experiment}/{table}.parquet"
        for experiment in ("tiny_grid", "tiny_fixed")
        for table in ("uncertainty", "shap")
    ]
    project.tiny("--config", "runs_per_job=10000", "--", *tables, cores=1)
    for pattern in ("results/*/*.parquet", "results/*/*/*.parquet", "resources/**/*.parquet"):
        found = project.digests(pattern)
        expected = finished.digests(pattern)
        assert found
        assert found == {path: expected[path] for path in found}
    assert len(project.digests("results/tiny_grid/**/runs/**/*.parquet")) == 1
    assert len(finished.digests("results/tiny_grid/**/runs/**/*.parquet")) > 1


class TestWhatRunsAgain:
    """Changes plan the jobs that they concern, and no registration that they do not."""

    @pytest.fixture
    def edited(self, finished, tmp_path):
        yield finished.with_copied_code(tmp_path)
        shutil.copy(TINY, finished.folder)

    def planned(self, project):
        return project.planned("--configfile", "tiny.yaml")

    def test_the_same_code_elsewhere_computes_nothing_again(self, edited):
        reads_the_papers_numbers = {"median_table", "compare_with_paper", "report"}
        others = {"all", "total", "provenance", "checksums"}
        assert set(self.planned(edited)) <= reads_the_papers_numbers | others

    def test_the_settings_of_a_figure_plan_no_registration(self, edited):
        change(edited.folder / "tiny.yaml", "figures: [summary, waterfall,", "figures: [waterfall,")
        assert not {"run_icp", "explain_sequence"} & set(self.planned(edited))

    def test_a_title_plans_what_shows_it_alone(self, edited):
        change(edited.folder / "tiny.yaml", "title: Tiny room", "title: A room")
        show_it = {"draw_figure", "draw_scene", "median_table", "report"}
        always = {"all", "total", "compare_with_paper", "provenance", "checksums"}
        planned = set(self.planned(edited))
        assert "draw_figure" in planned and planned <= show_it | always

    def test_another_divergence_plans_no_registration(self, edited):
        change(
            edited.folder / "tiny.yaml",
            "    runs: 60",
            "    runs: 60\n    divergence: symmetric_kl",
        )
        planned = self.planned(edited)
        assert planned["explain_sequence"] == 4
        assert "run_icp" not in planned

    def test_another_sequence_registers_only_itself(self, edited):
        change(
            edited.folder / "tiny.yaml",
            "estimators:",
            "  tiny_plain:\n    scans: 2\n    simulated: {scene: plain, beams: 6000}\nestimators:",
        )
        change(edited.folder / "tiny.yaml", "tiny_stairs]\nrun", "tiny_stairs, tiny_plain]\nrun")
        change(
            edited.folder / "tiny.yaml", "[tiny_room, tiny_stairs]\n    inst", "&all [x]\n    inst"
        )
        change(edited.folder / "tiny.yaml", "&all [x]", "[tiny_room, tiny_stairs, tiny_plain]")
        planned = self.planned(edited)
        assert planned["run_icp"] == 2

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("runs: 60", "runs: 70"),
            ("runs: 60", "runs: 60\n    minimum_range: 1.5"),
            ("runs_per_job: 300", "runs_per_job: 300\nperturbation: {overlap_distance: 0.3}"),
            ("fixed: {sensor_noise: 0.05,", "fixed: {sensor_noise: 0.07,"),
            ("runs_per_job: 300", "runs_per_job: 300\nseed: 1"),
        ],
    )
    def test_what_decides_the_poses_registers_again(self, edited, old, new):
        change(edited.folder / "tiny.yaml", old, new)
        assert self.planned(edited)["run_icp"] >= 3

    def test_editing_the_engine_registers_again(self, edited):
        change(edited.code / "icpshap/se3.py", "result[..., 3, 3] = 1.0", "result[..., 3, 3] = 2.0")
        assert self.planned(edited)["run_icp"] > 3

    def test_editing_a_cause_registers_the_experiments_that_name_it(self, edited):
        change(
            edited.code / "icpshap/causes/sensor_noise.py",
            "points + self._sigma",
            "points - self._sigma",
        )
        change(
            edited.folder / "tiny.yaml",
            "run: [tiny_grid, tiny_fixed, tiny_pose]",
            "run: [tiny_pose]",
        )
        assert "run_icp" not in self.planned(edited)
        change(
            edited.folder / "tiny.yaml",
            "run: [tiny_pose]",
            "run: [tiny_grid, tiny_fixed, tiny_pose]",
        )
        assert self.planned(edited)["run_icp"] >= 6

    def test_editing_an_estimator_registers_again(self, edited):
        path = edited.code / "icpshap/estimators/monte_carlo.py"
        change(path, "k * number", "0 + k * number")
        assert self.planned(edited)["run_icp"] > 6

    def test_another_cause_or_estimator_in_the_library_plans_nothing(self, edited):
        before = self.planned(edited)
        shutil.copy(REPOSITORY / "tests/made_causes.py", edited.code / "icpshap/causes/made.py")
        shutil.copy(REPOSITORY / "tests/known_estimator.py", edited.code / "icpshap/estimators")
        shutil.copy(REPOSITORY / "tests/known_runs.py", edited.code)
        assert self.planned(edited) == before

    def test_the_smallest_overlap_registers_nothing(self, edited):
        smallest = "runs_per_job: 300\nperturbation: {minimum_overlap: 0.2}"
        change(edited.folder / "tiny.yaml", "runs_per_job: 300", smallest)
        planned = self.planned(edited)
        assert planned["check_pairs"] == planned["explain_sequence"] == 4
        assert "run_icp" not in planned

    def test_more_scans_register_no_old_pair(self, edited):
        change(edited.folder / "tiny.yaml", "Tiny room\n    scans: 2", "Tiny room\n    scans: 3")
        planned = self.planned(edited)
        # The poses, the scans and the pairs anew, and the job or two of the new pair.
        assert planned["simulate_poses"] == planned["simulate_scans"] == 1
        assert planned["check_pairs"] == 1 and planned["run_icp"] <= 2

    def test_the_limits_of_a_basin_register_nothing(self, edited):
        change(
            edited.folder / "tiny.yaml", "runs: 60", "runs: 60\n    wrong_basin_translation: 0.2"
        )
        planned = self.planned(edited)
        assert planned["explain_sequence"] == 4
        assert "run_icp" not in planned

    def test_words_and_limits_of_the_fit_register_nothing(self, edited):
        change(edited.code / "icpshap/fit/checks.py", "DUPLICATES = 0.01", "DUPLICATES = 0.02")
        planned = self.planned(edited)
        assert planned["check_pairs"] == planned["explain_sequence"] == 4
        assert "run_icp" not in planned

    def test_editing_a_figure_plans_figures_alone(self, edited):
        change(
            edited.code / "icpshap/report/figures/style.py",
            "import numpy as np",
            "import json  # noqa\nimport numpy as np",
        )
        planned = self.planned(edited)
        assert planned["draw_figure"] > 3
        assert not {"run_icp", "explain_sequence", "check_pairs"} & set(planned)

    def test_editing_a_comment_does_not(self, edited):
        change(edited.code / "icpshap/se3.py", '"""Adjoint', '"""The adjoint')
        assert "run_icp" not in self.planned(edited)


class TestSeveralEstimators:
    """One experiment of several estimators: each an experiment of its own, all in one figure."""

    FILES = ("--configfile", "tiny.yaml", "tiny_estimators.yaml")

    @pytest.fixture
    def project(self, project):
        shutil.copy(TINY_ESTIMATORS, project.folder)
        return project

    def test_a_dry_run_plans_each_and_joins_them(self, project):
        planned = project.planned(*self.FILES)
        assert planned["explain_sequence"] == 4 and planned["join_estimators"] == 1
        alone = project.planned(*self.FILES, "--config", "run=[tiny_by_estimator_tiny_gicp]")
        assert alone["explain_sequence"] == 1 and "join_estimators" not in alone

    @pytest.mark.slow
    def test_all_are_in_one_figure_one_table_and_the_report(self, project):
        said = project.run(*self.FILES)
        results = project.folder / "results"
        table = pd.read_csv(results / "tiny_by_estimator/tables/by_estimator.csv")
        names = ["tiny", "tiny_closed_form", "tiny_gicp", "tiny_fitness"]
        assert list(table.estimator) == names
        for row in table.itertuples():
            shap = pd.read_parquet(results / f"tiny_by_estimator_{row.estimator}/shap.parquet")
            assert row.phi_sensor_noise == pytest.approx(shap.phi_sensor_noise.item())
        assert list(table.phi_sensor_noise_low.isna()) == [False, False, False, True]
        assert (table.phi_initial_pose[1:] == 0).all()
        folder = results / "tiny_by_estimator"
        for path in ("by_estimator.png", "by_estimator.svg", "by_estimator.txt"):
            assert (folder / "figures" / path).is_file()
        for path in ("by_estimator.md", "by_estimator.tex"):
            assert (folder / "tables" / path).is_file()
        page = (results / "report.html").read_text()
        assert 'id="tiny_by_estimator"' in page and 'id="tiny_by_estimator-by_estimator"' in page
        assert "results/tiny_by_estimator/ (figures/by_estimator.png, tables/by_estimator.m" in said
        assert "Nothing to be done" in project.run(*self.FILES)


@pytest.mark.slow
def test_what_if_runs_the_explained_instance_again_and_says_what_helps(project):
    changes = {
        "closer": {"initial_pose": 0.375},
        "more_points": {"subsampling_probability": 0.4},
    }
    overlay = {"run": ["tiny_pose"], "experiments": {"tiny_pose": {"what_if": changes}}}
    (project.folder / "what_if.yaml").write_text(yaml.safe_dump(overlay))
    files = ("--configfile", "tiny.yaml", "what_if.yaml")
    said = project.run(*files)
    results = project.folder / "results" / "tiny_pose"
    table = pd.read_csv(results / "tables" / "what_if.csv")
    assert list(table["what_if"]) == ["as it is", *changes]
    shap = pd.read_parquet(project.folder / "results/tiny_pose_closer/shap.parquet")
    assert table["f"][1] == pytest.approx(shap["f"][0])
    told = (results / "tables" / "what_if.md").read_text().splitlines()[-1]
    assert told in said and told in (project.folder / "results/report.html").read_text()
    assert "tiny_pose_closer (" not in said  # no finding of its own
    assert "Nothing to be done" in project.run(*files)


def test_a_clone_that_can_only_be_read_serves_another_folder(tmp_path):
    """Also where it is named by a path from there, through `..`."""
    for folder in ("clone", "work"):
        (tmp_path / folder).mkdir()
    clone = Project(tmp_path / "work").with_copied_code(tmp_path / "clone").code
    before = sorted(clone.rglob("*"))
    for folder in (clone, *filter(Path.is_dir, before)):
        folder.chmod(0o555)
    scan = "resources/tiny_room/scans/0.parquet"
    Project(tmp_path / "work", code=Path("../clone")).run(scan, "--configfile", "tiny.yaml")
    assert (tmp_path / "work" / scan).is_file()
    assert sorted(clone.rglob("*")) == before


def test_a_dry_run_needs_no_data_and_no_network(project):
    planned = project.planned()
    sequences = yaml.safe_load((REPOSITORY / "config.yaml").read_text())["sequences"]
    assert planned["check_pairs"] == planned["explain_sequence"] == 1 + len(sequences)
    # Jobs of at most 16,000 runs, several pairs to one: 9 settings of each of 267 pairs; of the
    # grid a noise level is one.
    fewest = 9 * 267 * 100 / 16000 + 11
    assert fewest <= planned["run_icp"] <= fewest + len(sequences)
    fetched = planned["fetch_scan"] + planned["fetch_poses"]
    assert fetched == 275 + 8 and planned["total"] - fetched <= 150


class TestBadInput:
    """One clear message, before any registration."""

    @pytest.fixture
    def own(self, project):
        """A project with a folder of own scans."""
        import numpy as np

        folder = project.folder / "scans"
        folder.mkdir()
        generator = np.random.default_rng(0)
        for index in range(2):
            points = generator.uniform(2, 6, (1500, 3))
            pd.DataFrame(points, columns=list("xyz")).to_csv(folder / f"s{index}.csv", index=False)
        pose = "1 0 0 0 0 1 0 0 0 0 1 0\n"
        (folder / "poses.txt").write_text(2 * pose)
        config = yaml.safe_load(TINY.read_text())
        config["data"] = {"own": {"scans": 2, "folder": {"path": "scans"}}}
        config["experiments"]["tiny_fixed"]["sequences"] = ["own"]
        config["experiments"]["tiny_fixed"]["figures"] = []
        del config["experiments"]["tiny_grid"], config["experiments"]["tiny_pose"]
        config |= {"sequences": ["own"], "run": ["tiny_fixed"]}
        (project.folder / "tiny.yaml").write_text(yaml.safe_dump(config))
        return project

    def fails(self, project, *arguments):
        said = project.tiny(*arguments, fails=True)
        assert "Traceback" not in said
        assert not list(project.folder.glob("results/**/runs"))
        return said

    def test_unknown_sequence(self, project):
        said = self.fails(project, "--config", "sequences=[tiny_stair]")
        assert "unknown name 'tiny_stair', did you mean 'tiny_stairs'?" in said

    def test_nan_rows(self, own):
        path = own.folder / "scans" / "s1.csv"
        path.write_text(path.read_text() + "nan,1,1\n1,inf,1\n")
        assert "s1.csv: 2 of 1502 rows are not finite" in self.fails(own)

    def test_cut_off_scan(self, own):
        path = own.folder / "scans" / "s1.csv"
        path.write_text(path.read_text()[:-30])
        assert "s1.csv, line 1501: 2 columns, expected 3" in self.fails(own)

    def test_empty_scan(self, own):
        (own.folder / "scans" / "s0.csv").write_text("")
        assert "s0.csv, line 1: expected a header" in self.fails(own)

    def test_a_pose_too_few(self, own):
        path = own.folder / "scans" / "poses.txt"
        path.write_text(path.read_text().splitlines()[0] + "\n")
        assert "poses.txt: 1 poses, but the configuration says `scans: 2`" in self.fails(own)

    def test_one_bad_sequence_stops_before_the_others_are_registered(self, own):
        config = yaml.safe_load((own.folder / "tiny.yaml").read_text())
        config["data"]["tiny_room"] = yaml.safe_load(TINY.read_text())["data"]["tiny_room"]
        config["experiments"]["tiny_fixed"]["sequences"] = ["tiny_room", "own"]
        config["sequences"] = ["tiny_room", "own"]
        (own.folder / "tiny.yaml").write_text(yaml.safe_dump(config))
        (own.folder / "scans" / "s1.csv").write_text("")
        assert "s1.csv, line 1: expected a header" in self.fails(own)

    def test_missing_scan(self, own):
        (own.folder / "scans" / "s1.csv").unlink()
        assert "scans: 2" in self.fails(own)

    def test_missing_folder(self, own):
        shutil.rmtree(own.folder / "scans")
        assert "data.own: scans: no such folder" in self.fails(own)

    def test_a_red_check_where_the_run_shall_stop(self, own):
        """Scans in millimetres, which else are registered, and the check said first."""
        for path in (own.folder / "scans").glob("*.csv"):
            rows = pd.read_csv(path)
            rows[["x", "y", "z"]] *= 1000
            rows.to_csv(path, index=False)
        said = self.fails(own, "--config", "stop_at_red=true")
        assert "the settings do not fit the scans. Half of the points are within" in said
        assert "multiply by 0.001" in said

    def test_larger_reduction_than_overlap(self, own):
        path = own.folder / "scans" / "poses.txt"
        first, _ = path.read_text().splitlines()
        path.write_text(first + "\n" + first.replace("1 0 0 0 ", "1 0 0 2.5 ", 1) + "\n")
        change(own.folder / "tiny.yaml", "partial_overlap: 0.05", "partial_overlap: 0.9")
        assert "is larger than their overlap ratio" in self.fails(own)


@pytest.mark.slow
def test_real_pair(project, real_data):
    """First run on real input: sensor noise decides, as in the paper."""
    config = yaml.safe_load(TINY.read_text())
    config["data"] = {
        "pair": {"scans": 2, "folder": {"path": str(real_data / "apartment_pair")}},
    }
    config["estimators"] = {"quarter": {"based_on": "paper", "subsampling_probability": 0.25}}
    config["experiments"] = {
        "real": {
            "based_on": "same_perturbation",
            "estimator": "quarter",
            "sequences": ["pair"],
        }
    }
    config |= {"sequences": ["pair"], "run": ["real"]}
    (project.folder / "tiny.yaml").write_text(yaml.safe_dump(config))
    project.tiny("--", "results/real/shap.parquet")
    shap = pd.read_parquet(project.folder / "results" / "real" / "shap.parquet").iloc[0]
    others = [abs(shap["phi_initial_pose"]), abs(shap["phi_partial_overlap"])]
    assert shap["phi_sensor_noise"] > 5 * max(others)
