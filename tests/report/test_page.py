"""The report on one page, and its short form."""

import re
import shutil
import subprocess
from dataclasses import replace
from html import unescape
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from known_results import (
    FIXED,
    OF_NUMBER,
    PAIRS,
    PRINTED,
    STUDY,
    WATERFALL,
    directions_table,
    fit_table,
    fixed_of,
    of_covariances,
    pair_of_scans,
    ranking,
    ranking_row,
    runs_table,
    shap_table,
    study_of,
    without_value,
)

from icpshap import causes, tables
from icpshap.explanation.method import Method
from icpshap.jobs import provenance as record
from icpshap.report import captions, directions, figures
from icpshap.report import page as report
from icpshap.report.figures import scene, style
from icpshap.report.study import pairs_of


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A page of two sections with all of their figures, as the workflow lays files out."""
    root = tmp_path_factory.mktemp("results")
    fixed = without_value(shap_table(FIXED, PAIRS), [1], "overlap ratio 0.08 is not above 0.1")
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
            figure, caption = figures.draw(name, table, None, study)
            style.save(figure, folder / f"{name}.svg")
            (folder / f"{name}.txt").write_text(caption)
            plt.close(figure)
        (root / scope / "shap.parquet").touch()
        of_pairs = pairs_of(table)
        paths = [folder / f"{name}.svg" for name in names]
        links = [root / scope / "shap.parquet"]
        sections.append(
            report.Section(
                scope,
                study,
                table,
                directions_table(),
                of_pairs.assign(warning=""),
                fit_table(table),
                None,
                ranked,
                paths,
                links,
            )
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


def test_page_tells_errors_and_the_weakest_direction_once(results):
    section = results.sections[1]
    section = replace(section, study=replace(section.study, waterfall=None))
    run = record.provenance({"run": []}, {}, results.root, results.root)
    text = unescape(report.page([section], run, results.root))
    assert text.count(directions.html(section.directions, section.study)) == 1
    assert text.count(directions.opening(section.directions, section.study)) == 1
    assert text.count(directions.note(section.directions, section.study)) == 1
    assert not any(said in text for said in directions.sentences(section.directions, section.study))


def test_medians_of_a_sequence_need_five_pairs(results):
    run = record.provenance({"run": []}, {}, results.root, results.root)
    for pairs, told in ((5, True), (4, False)):
        section = replace(results.sections[1], ranking=ranking(ranking_row("eth", n_pairs=pairs)))
        text = report.page([section], run, results.root)
        assert ("Median Shapley values</h3>" in text) == told
        assert ("P(" in text) == told


def test_what_all_captions_say_stands_on_the_page_once(results):
    page = unescape(results.page)
    study = results.sections[0].study
    for said in (*captions.method(results.sections[0].shap, study), *captions.symbols(study)):
        assert page.count(said) <= len(results.sections), said
    for path in results.sections[0].figures:
        assert captions.symbols(study)[0] in path.with_suffix(".txt").read_text()


def test_figures_are_as_wide_as_the_text(results):
    widths = {int(width) for width in re.findall(r'<img [^>]*width="(\d+)"', results.page)}
    assert widths == {928}  # pixels of 58 rem


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
        assert captions.finding(section.shap, section.directions, section.study) in text
    assert text.count(captions.symbols(STUDY)[0]) == text.count("Clean: no cause is on.") == 1
    assert text.count("An instance: ") == 1
    assert "opens with 3 kinds of warnings, the gravest: Pairs that were not registered." in text
    assert len(text.splitlines()) < 24


@pytest.mark.parametrize("kind", ["monte_carlo", "closed_form"])
@pytest.mark.parametrize("number", OF_NUMBER)
def test_page_of_any_causes_says_what_the_estimator_returned(number, kind, tmp_path):
    study = study_of(OF_NUMBER[number], kind=kind)
    table = fixed_of(study.causes)
    table = of_covariances(table) if kind == "closed_form" else table
    ranked = ranking(ranking_row("eth", causes=study.causes))
    pairs = pairs_of(table).assign(warning="")
    nothing = tables.empty("directions", study.causes)
    section = report.Section(
        "an_experiment", study, table, nothing, pairs, fit_table(table), None, ranked, [], []
    )
    page = report.page([section], record.provenance({"run": []}, {}, tmp_path, tmp_path), tmp_path)
    assert captions.returned(study) in page
    assert all(cause.title in page for cause in study.players)
    exact = "The estimator is deterministic: without a perturbation f is exactly 0."
    assert page.count(exact) == (kind == "closed_form")


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
def test_interactive_page_draws_its_three_scenes(tmp_path):
    pair = pair_of_scans()
    runs = runs_table([{cause.name: cause.off for cause in STUDY.players}, WATERFALL])
    kept = [np.ones(len(scan), dtype=bool) for scan in (pair.reference, pair.source)]
    shown = scene.make_scene(pair, *kept, runs, WATERFALL, Method(), 3.0)
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


def test_what_is_wrong_with_the_scans_comes_first(results):
    row = {
        "sequence": "apartment",
        "reference": 0,
        "source": 1,
        "against": "other pairs",
        "verdict": "found",
        "causes": "sensor_noise",
        "confidence": 0.95,
        **{f"level_{name}": 0.03 for name in causes.shown()},
        **{f"z_{name}": 9.0 for name in causes.shown()},
    }
    calm = {**row, "source": 2, "verdict": "nothing", "causes": ""}
    section = replace(results.sections[0], diagnosis=pd.DataFrame([row, calm]))
    run = record.provenance({"run": ["grid"]}, {}, results.root, results.root)
    page = report.page([section], run, results.root)
    told = page.index("Of 2 pairs 1 stands out beside the others: Apartment 0–1: sensor noise")
    assert page.index('id="diagnosis"') < told < page.index('id="fit"') < page.index("<figure")
    assert "Not visible in scans" in page
    assert "clean runs in a wrong basin" in page


def test_the_same_words_of_two_sequences_are_said_of_each(results):
    row = {
        "sequence": "apartment",
        "reference": 0,
        "source": 1,
        "against": "other pairs",
        "verdict": "nothing",
        "causes": "",
        "confidence": 0.95,
        **{f"z_{name}": 0.1 for name in causes.shown()},
    }
    calm = pd.DataFrame([row, {**row, "reference": 1, "source": 2}])
    sections = [
        replace(results.sections[0], diagnosis=calm),
        replace(results.sections[0], diagnosis=calm.assign(sequence="stairs")),
    ]
    assert len(report._diagnoses(sections)) == 2
    assert len(report._diagnoses([sections[0], sections[0]])) == 1


def test_a_pair_that_is_held_against_none_is_not_diagnosed(results):
    assert 'id="diagnosis"' not in results.page
