"""The report, the tables for people, the comparison with the paper, and what a run says."""

import io
import logging
import re
import shutil
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import yaml
from known_results import FIXED, STUDY, WATERFALL, runs_table, shap_table, without_value

from icpshap.causes import NAMES, SOURCES
from icpshap.estimators.perturb import Streams
from icpshap.jobs import progress
from icpshap.jobs import provenance as record
from icpshap.report import captions, comparison, figures
from icpshap.report import page as report
from icpshap.report import tables as median_table
from icpshap.report.figures import scene, style

PAPER = pd.DataFrame(
    [
        ("waterfall", 0.1, 1.5, 0.05, "phi_sensor_noise", 39.61, 39.61),
        ("summary", np.nan, np.nan, np.nan, "phi_initial_pose", -1.2, 22.2),
    ],
    columns=["figure", *NAMES, "quantity", "low", "high"],
)


def ranking_row(sequence, rule="iqr", **changes):
    row = {"sequence": sequence, "outlier_rule": rule, "n_pairs": 5, "n_rows": 5, "n_removed": 1}
    for name, value in zip(NAMES, (8.0, 0.1, 2.0), strict=True):
        row |= {
            f"median_{name}": value,
            f"median_{name}_low": value - 0.5,
            f"median_{name}_high": value + 0.5,
            f"paper_{name}": np.nan,
            f"paper_{name}_inside": False,
        }
    row |= {"order": "sensor_noise > partial_overlap > initial_pose", "warning": ""}
    return row | {"probability": 0.98, "p": 0.01, "p_holm": 0.02} | changes


def ranking(*rows):
    return pd.DataFrame(rows)


PRINTED = {"paper_sensor_noise": 7.9, "paper_sensor_noise_inside": True}


# --- the median table -----------------------------------------------------------------------------


def test_median_table_marks_what_cannot_be_told_from_zero():
    text = median_table.markdown(ranking(ranking_row("apartment")), STUDY)
    assert re.search(r"8\.00 \[7\.50, 8\.50\] +\| 0\.10 \[-0\.40, 0\.60\]° +\|", text)
    assert "| Apartment  | 4 of 5" in text
    assert "0.98 (p = 0.02)" in text
    assert "P(sensor noise > partial overlap > initial pose scale)" in text


def test_median_table_sets_the_papers_value_beside_ours():
    row = ranking_row("apartment", **PRINTED)
    text = median_table.markdown(ranking(row, ranking_row("eth")), STUDY)
    assert re.search(r"8\.00 \[7\.50, 8\.50\] +\| 7\.90 +\|", text)
    assert "1 of the paper's 1 values lie in our intervals." in text
    without = median_table.markdown(ranking(ranking_row("eth")), STUDY)
    assert "paper" not in without.replace("estimator paper", "")


def test_latex_table_compiles_in_its_parts():
    text = median_table.latex(ranking(ranking_row("apartment")), STUDY)
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 1
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {line.count("&") for line in rows} == {5}
    assert r"0.10 [-0.40, 0.60]$^\circ$" in text
    assert "°" not in text and " > " not in text.split("\n", 1)[1]


def test_median_table_of_a_sequence_without_values():
    nothing = {f"median_{name}{end}": np.nan for name in NAMES for end in ("", "_low", "_high")}
    row = ranking_row("eth", probability=np.nan, p_holm=np.nan, n_rows=0, n_removed=0, **nothing)
    text = median_table.markdown(ranking(row), STUDY)
    assert "| no value" in text
    assert "nan" not in text


def test_every_reading_of_the_outlier_rule_is_listed():
    rows = [ranking_row("apartment", rule) for rule in median_table.RULES]
    text = median_table.markdown(ranking(*rows), STUDY)
    for rule in median_table.RULES.values():
        assert f"| {rule} " in text


# --- against the paper ----------------------------------------------------------------------------


def test_comparison_takes_values_from_where_the_paper_has_them():
    table = shap_table()
    rows = comparison.compare_figures(table, PAPER, STUDY).set_index("shown_in")
    shown = captions.instance(table, WATERFALL).iloc[0]
    assert rows.loc["waterfall plot", "value"] == shown.phi_sensor_noise
    assert rows.loc["waterfall plot", "low"] == shown.phi_sensor_noise_low
    noisy = table[table.sensor_noise > 0].phi_initial_pose
    assert rows.loc["summary plot", ["low", "high"]].tolist() == [noisy.min(), noisy.max()]
    other_pair = comparison.compare_figures(shap_table(pairs=[("eth", 6, 7)]), PAPER, STUDY)
    assert len(other_pair) == 0


def test_comparison_of_medians_uses_the_default_rule_and_known_values():
    rows = [ranking_row("apartment", rule, **PRINTED) for rule in median_table.RULES]
    table = comparison.compare_medians(ranking(*rows), STUDY)
    assert table[["source", "value", "paper_low"]].to_numpy().tolist() == [
        ["sensor_noise", 8.0, 7.9]
    ]
    assert "1 of 1 single values of the paper lie in our intervals." in comparison.caption(table)


def test_only_the_papers_perturbation_and_divergence_are_compared():
    assert comparison.is_comparable(shap_table(FIXED), STUDY)
    assert not comparison.is_comparable(shap_table(FIXED | {"sensor_noise": (0.1,)}), STUDY)
    assert not comparison.is_comparable(shap_table(FIXED), replace(STUDY, divergence="reverse_kl"))
    assert not comparison.is_comparable(shap_table(), STUDY)


def test_comparison_figure_has_every_estimator_and_the_paper():
    parts = [
        comparison.compare_medians(
            ranking(ranking_row("apartment", **PRINTED)), replace(STUDY, estimator=estimator)
        )
        for estimator in ("paper", "robust")
    ]
    figure = comparison.draw(pd.concat(parts), STUDY.titles)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert lines["ours, estimator robust"].get_xdata() == pytest.approx([8.0])
    assert lines["the paper"].get_xdata() == pytest.approx([7.9, 7.9])
    assert [axes.get_xlabel()[-6:] for axes in figure.axes] == ["[nats]"] * 3
    plt.close("all")


# --- provenance -----------------------------------------------------------------------------------


def test_provenance_survives_yaml_and_names_licences(tmp_path):
    config = {"run": ["an_experiment"], "seed": 1}
    sequences = {"apartment": "archive", "room": "simulated"}
    made_with = record.provenance(config, sequences, tmp_path, tmp_path)
    assert yaml.safe_load(yaml.safe_dump(made_with)) == made_with
    assert "CC BY 4.0" in made_with["data"]["apartment"]
    assert made_with["data"]["room"] == "made by icpshap, MIT"
    assert made_with["packages"]["numpy"] == np.__version__
    assert made_with["commit"] == ""
    assert made_with["host"]["cores"] >= 1


def test_commit_says_when_files_differ(tmp_path):
    def git(*arguments):
        subprocess.run(["git", "-C", tmp_path, *arguments], check=True, capture_output=True)

    git("init")
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-m", "first")
    assert re.fullmatch(r"[0-9a-f]{40}", record.commit(tmp_path))
    (tmp_path / "file").write_text("two")
    assert re.fullmatch(r"[0-9a-f]{40}-dirty", record.commit(tmp_path))


def test_job_times_count_the_selected_only(tmp_path):
    for path, seconds in {
        "run_icp/chosen/room/0-1/0.tsv": 2.5,
        "run_icp/chosen/room/0-1/1.tsv": 4.0,
        "run_icp/other/room/0-1/0.tsv": 99.0,
        "draw_figure/other/summary.tsv": 1.0,
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(f"s\th:m:s\n{seconds}\t0:00:00\n")
    times = record.job_times(tmp_path, {"chosen"})
    assert times.to_numpy().tolist() == [["run_icp", 2, 6.5, 4.0]]


# --- the page -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A page of two sections with all of their figures, as the workflow lays files out."""
    root = tmp_path_factory.mktemp("results")
    pairs = (("apartment", 0, 1), ("apartment", 1, 2), ("eth", 0, 1))
    fixed = without_value(shap_table(FIXED, pairs), [1], "overlap ratio 0.08 is not above 0.1")
    grid = shap_table().assign(warning="the floor makes up 90% of the clean variance", n_failed=2)
    sections = []
    for scope, table, names, ranked in (
        ("grid", grid, ["summary", "waterfall", "interactions"], None),
        ("fixed", fixed, ["summary", "pairs"], ranking(ranking_row("apartment", **PRINTED))),
    ):
        folder = root / scope / "figures"
        folder.mkdir(parents=True)
        study = replace(STUDY, name=scope)
        for name in names:
            figure, caption = figures.draw(name, table, study)
            style.save(figure, folder / f"{name}.svg")
            (folder / f"{name}.txt").write_text(caption)
            plt.close(figure)
        (root / scope / "shap.parquet").touch()
        of_pairs = table.drop_duplicates(["sequence", "reference", "source"])
        paths = [folder / f"{name}.svg" for name in names]
        links = [root / scope / "shap.parquet"]
        sections.append(
            report.Section(scope, study, table, of_pairs.assign(warning=""), ranked, paths, links)
        )
    (root / "grid" / "figures" / "waterfall.html").write_text("<title>turns</title>")
    run = record.provenance({"run": ["grid", "fixed"]}, {"apartment": "archive"}, root, root)
    page = report.page(sections, run, root)
    (root / "report.html").write_text(page)
    return SimpleNamespace(root=root, page=page, sections=sections)


def test_page_says_warnings_before_figures(results):
    page = results.page
    assert page.index('id="warnings"') < page.index("<figure")
    warnings = page[page.index('id="warnings"') : page.index("<figure")]
    assert "Not registered: Apartment 1–2 (overlap ratio 0.08 is not above 0.1)." in warnings
    assert "the floor makes up 90% of the clean variance" in warnings
    assert "runs that failed, at most 2 of 100" in warnings


def test_page_holds_every_picture_and_needs_no_other_file(results):
    images = re.findall(r'<img src="([^"]{0,40})', results.page)
    assert len(images) == 5
    assert all(image.startswith("data:image/svg+xml;base64,") for image in images)
    assert not re.search(r'<(script|link|img|iframe)[^>]*(src|href)="(?!data:)', results.page)


def test_links_of_the_page_work(results):
    links = re.findall(r'<a href="([^"]*)"', results.page)
    anchors = set(re.findall(r' id="([^"]*)"', results.page))
    assert any("waterfall.html" in link for link in links)
    for link in links:
        if link.startswith("#"):
            assert link[1:] in anchors
        else:
            assert (results.root / link).is_file(), link


def test_page_states_what_was_run(results):
    for text in ("CC BY 4.0", f"numpy {np.__version__}", "95 % intervals", "run:\n- grid"):
        assert text in results.page
    assert "1 of the paper&#39;s 1 values lie in our intervals." in results.page


def test_names_from_the_configuration_cannot_break_the_page(results):
    section = results.sections[1]
    titles = {"apartment": "<script>alert(1)</script>", "eth": "ETH & co"}
    section = replace(section, study=replace(section.study, titles=titles))
    run = record.provenance({"run": []}, {}, results.root, results.root)
    page = report.page([section], run, results.root)
    assert "<script>alert" not in page
    assert "ETH &amp; co" in page


def test_summary_says_where_results_are_and_what_was_found(results):
    text = report.summary(results.sections, "results/report.html")
    assert "Report: results/report.html" in text
    assert "results/grid/" in text and "results/fixed/" in text
    for section in results.sections:
        assert captions.finding(section.shap, section.study) in text
    assert re.search(r"opens with \d+ warnings", text)
    assert len(text.splitlines()) < 24


CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)


def browse(page, profile, *options):
    """What headless chromium prints and says on its console when it opens a page."""
    quiet = (
        "--disable-gpu --no-first-run --disable-background-networking --disable-component-update"
    )
    command = [CHROMIUM, "--headless", "--no-sandbox", *quiet.split(), "--disable-sync"]
    command += [f"--user-data-dir={profile}", "--enable-logging=stderr", *options, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here: the page was not opened")
def test_page_opens_in_a_browser_and_every_picture_shows(results, tmp_path):
    probe = (
        "<script>addEventListener('load', () => document.title = 'shown: ' + "
        "[...document.images].filter(i => i.complete && i.naturalWidth > 0).length)</script>"
    )
    page = results.root / "probed.html"
    page.write_text(results.page.replace("</head>", probe + "</head>"))
    dom, console = browse(page, tmp_path, "--dump-dom")
    assert console == []
    assert "<title>shown: 5</title>" in dom


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here: the page was not opened")
def test_interactive_page_draws_its_three_scenes(room_pair, tmp_path):
    runs = runs_table([{source.name: source.off for source in SOURCES}, WATERFALL])
    shown = scene.make_scene(room_pair, runs, WATERFALL, Streams(1, "apartment", 6, 7))
    page = tmp_path / "page.html"
    page.write_text(scene.page(shown, "Apartment 6–7", "what it shows"))
    dom, console = browse(
        page,
        tmp_path / "profile",
        "--enable-unsafe-swiftshader",
        "--use-angle=swiftshader",
        "--virtual-time-budget=5000",
        "--dump-dom",
    )
    assert not [line for line in console if "rror" in line]
    assert dom.count("<canvas") >= 3


# --- what a run says ------------------------------------------------------------------------------


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def watched():
    """A logger whose jobs `progress` reports, and what reaches the terminal by both ways."""
    terminal, own, clock = io.StringIO(), io.StringIO(), Clock()
    logger = logging.Logger("snakemake")
    logger.addHandler(logging.StreamHandler(own))
    lines = progress.Progress(terminal, lambda: (20, 2000), lambda wildcards: (5, 500), clock)
    dry = SimpleNamespace(run=False)
    progress.replace_job_lines(logger, lines, lambda: dry.run)
    return SimpleNamespace(
        logger=logger, lines=lines, terminal=terminal, own=own, clock=clock, dry=dry
    )


def run_job(logger, number, rule, **wildcards):
    info = {"event": "job_info", "jobid": number, "rule_name": rule, "wildcards": wildcards}
    logger.info("starts", extra=info)
    logger.info("ends", extra={"event": "job_finished", "job_id": number})


def test_a_line_per_job_with_settings_done_rate_and_time_left(watched):
    watched.logger.info("Job stats", extra={"event": "run_info", "stats": {"total": 12}})
    run_job(watched.logger, 3, "read_scan", sequence="room", index="0")
    info = {"event": "job_info", "jobid": 4, "rule_name": "run_icp", "wildcards": {"chunk": "0"}}
    watched.logger.info("starts", extra=info)
    watched.clock.now = 2.0
    watched.logger.info("ends", extra={"event": "job_finished", "job_id": 4})
    assert watched.terminal.getvalue().splitlines() == [
        "[ 1/12] read_scan room 0",
        "[ 2/12] run_icp 0: 5 of 20 settings, 250 ICP runs a second, 0:06 left",
    ]
    assert watched.own.getvalue() == "Job stats\n"


def test_errors_and_other_messages_still_reach_the_terminal(watched):
    failed = {"event": "job_error", "log": ["logs/run_icp/room/0-1/0.log"]}
    watched.logger.error("a job failed", extra=failed)
    watched.logger.info("Nothing to be done")
    watched.logger.info("Select jobs to execute...")
    assert watched.own.getvalue() == "a job failed\nNothing to be done\n"
    said = progress.failure(watched.lines.failed)
    assert said.startswith("1 job(s) failed; what they said is in\n  logs/run_icp/room/0-1/0.log\n")
    assert "Hint: mend the cause and run the same command again" in said


def test_a_dry_run_keeps_snakemakes_own_lines(watched):
    watched.dry.run = True
    watched.logger.info("Job stats", extra={"event": "run_info", "stats": {"total": 1}})
    run_job(watched.logger, 3, "read_scan", sequence="room")
    assert watched.terminal.getvalue() == ""
    assert watched.own.getvalue() == "Job stats\nstarts\nends\n"


@pytest.mark.parametrize("seconds, text", [(0.2, "0:00"), (65, "1:05"), (3661.4, "1:01:01")])
def test_durations(seconds, text):
    assert progress.duration(seconds) == text
