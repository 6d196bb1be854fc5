import re
from types import SimpleNamespace

import matplotlib.pyplot as plt
import pandas as pd
import pytest

from icpshap import causes
from icpshap.report import diagnosis
from icpshap.report.figures import diagnosis as pictures

NUMBERS = {
    "sequence": "drive",
    "reference": 0,
    "source": 1,
    "against": "other pairs",
    "healthy_pairs": 8,
    "weakest": "along x",
    "weakest_information": 0.021,
    "verdict": "nothing",
    "causes": "",
    "confidence": 0.97,
    **{f"level_{name}": 0.0 for name in causes.shown()},
    **{f"z_{name}": 0.1 for name in causes.shown()},
}
NOISE = {
    "verdict": "found",
    "causes": "sensor_noise",
    "level_sensor_noise": 0.031,
    "z_sensor_noise": 12.3,
}
TWO = {"verdict": "undecided", "causes": "partial_overlap, under_constrained"}


def table(*changes):
    return pd.DataFrame([{**NUMBERS, "reference": k, **one} for k, one in enumerate(changes)])


def row(**changes):
    return next(table(changes).itertuples())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({}, "Beside 8 other pairs nothing stands out (probability 0.97)."),
        (
            NOISE,
            "Beside 8 other pairs sensor noise (σ = 0.031 m, +12.3 standard deviations) stands out "
            "(probability 0.97).",
        ),
        (
            TWO,
            "Beside 8 other pairs partial overlap and under-constrained situation cannot be told "
            "apart; one of them stands out (probability 0.97).",
        ),
        ({"healthy_pairs": 1}, "Beside 1 other pair nothing stands out (probability 0.97)."),
        (
            {"against": "data sheet"},
            "Beside the scanner's data sheet the noise does not stand out (probability 0.97).",
        ),
        ({"confidence": 1.0}, "Beside 8 other pairs nothing stands out (probability above 0.99)."),
    ],
)
def test_the_verdict_is_a_sentence(changes, sentence):
    assert diagnosis.sentence(row(**changes)) == sentence


def test_a_pair_alone_is_told_what_to_give():
    alone = row(against="nothing", healthy_pairs=0, verdict="unknown", confidence=float("nan"))
    assert "give healthy pairs of the same scanner" in diagnosis.sentence(alone)


def test_the_weakest_direction_is_told_beside_an_even_one():
    assert diagnosis.weakest(row()) == (
        "Weakest direction: along x, with 2.1 % of the information (16.7 % is even)."
    )


def test_what_no_scan_shows_is_said():
    text = diagnosis.unseen()
    assert "Told by the configuration, not measured: initial pose scale and ICP randomness" in text
    assert "Not visible in scans: range bias and motion distortion" in text


def test_of_many_pairs_those_that_stand_out_are_named():
    text = diagnosis.summary(table({}, NOISE, TWO), lambda row: f"Drive {row.reference}")
    assert text.startswith("Of 3 pairs 2 stand out beside the others: Drive 1: sensor noise (σ =")
    assert text.endswith("Drive 2: partial overlap or under-constrained situation.")
    one = diagnosis.summary(table({}, NOISE), lambda row: "Drive")
    assert one.startswith("Of 2 pairs 1 stands out beside the others: Drive: sensor noise")
    calm = diagnosis.summary(table({}, {}), lambda row: "")
    assert calm == "Nothing stands out in any of 2 pairs, each beside the others."


def test_pairs_that_cannot_be_measured_are_counted_apart():
    lost = {"against": "nothing", "verdict": "unknown", "weakest_information": float("nan")}
    text = diagnosis.summary(table({}, lost, {}), lambda row: "")
    assert text == (
        "Nothing stands out in any of 2 pairs, each beside the others. Of 1 more nothing "
        "can be said."
    )
    assert "hardly overlap at the pose" in diagnosis.sentence(row(**lost))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, ""),
        (
            {"healthy_pairs": 2},
            "of at least 5 % (15 % of the weakest information), which is assumed",
        ),
        ({"against": "data sheet"}, "nothing of overlap and directions"),
    ],
)
def test_what_the_others_do_not_say_is_said(changes, said):
    text = diagnosis.doubts(row(**changes))
    assert said in text and bool(text) == bool(said)


def test_the_figure_has_a_cell_of_each_pair_and_cause():
    figure = pictures.picture(table({}, NOISE, TWO), {"drive": "Drive"})
    axes = figure.axes[0]
    assert axes.images[0].get_array().shape == (3, len(causes.shown()))
    assert [text.get_text() for text in axes.texts] == ["σ = 0.031 m", "?", "?"]
    assert axes.get_yticklabels()[1].get_text() == "Drive 1–1"
    plt.close(figure)


def test_a_figure_without_pairs_to_compare_says_so():
    alone = {"against": "nothing", "verdict": "unknown"}
    figure = pictures.picture(table(alone), {})
    assert "No pair can be held against another one." in figure.axes[0].texts[0].get_text()
    plt.close(figure)


def test_the_caption_says_what_is_not_seen():
    assert "What all pairs have is not seen" in pictures.caption(table({}))


def test_the_caption_counts_the_pairs_that_are_shown():
    caption = pictures.caption(table({}, NOISE, {"verdict": "unknown"}))
    assert "2 pairs; 1 more could not be held against another one." in caption


def shap(shares):
    places = range(len(shares))
    keys = {"sequence": "drive", "reference": places, "source": 1}
    return pd.DataFrame({**keys, "clean_wrong_basin_share": shares})


def test_each_experiment_says_where_its_clean_runs_end():
    study = SimpleNamespace(pair=lambda row: f"Drive {row.reference}")
    # The first has only one of the pairs; two of the three say the same.
    shaps = {"small": shap([0.02]), "large": shap([0.02, 0.1]), "twin": shap([0.02, 0.1])}
    page = str(diagnosis.html(table({}, NOISE), shaps, study))
    titles = [title.strip() for title in re.findall("<th>([^<]*)", page)]
    assert titles[-2:] == [f"{diagnosis.LOST}, small", f"{diagnosis.LOST}, large, twin"]
    assert page.count("2%") == 2 and page.count("10%") == 1
    alone = str(diagnosis.html(table({}, NOISE), {"large": shaps["large"]}, study))
    assert re.findall("<th>([^<]*)", alone)[-1].strip() == diagnosis.LOST
