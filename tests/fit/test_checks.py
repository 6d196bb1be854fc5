"""The fit table: each misfit is named with its number and the change that mends it."""

import numpy as np
import pandas as pd
import pytest
from known_results import FIXED, PAIRS, fit_numbers, fit_table, shap_table

from icpshap import tables
from icpshap.data import ground_truth
from icpshap.errors import DataError
from icpshap.fit import checks

ONE = shap_table(FIXED, PAIRS[:1])

# What of fit_numbers is another; the grade, words of the sentence, and words of the remedy.
MISFITS = {
    "rings": (
        {"ring_share": 0.93, "line_share": 0.57, "mending_voxel": 0.25, "mending_neighbours": 20},
        "red",
        "93% of the neighbourhoods of 7 points lie on one ring of the scanner (57% on a line",
        "voxel_size: 0.25, normal_neighbours: 20",
    ),
    "some rings": (
        {"ring_share": 0.3, "mending_neighbours": 20},
        "remark",
        "30% of the neighbourhoods",
        "normal_neighbours: 20",
    ),
    "rings that nothing mends": (
        {"ring_share": 0.9},
        "red",
        "90% of the neighbourhoods",
        "scans of more rings",
    ),
    "normals below the noise": (
        {"normal_radius": 0.04, "largest_noise": 0.08},
        "remark",
        "normals span 4 cm, noise is 8 cm",
        "normal_neighbours: 30",
    ),
    "normals far below the noise": (
        {"normal_radius": 0.01, "largest_noise": 0.06},
        "remark",
        "normals span 1 cm, noise is 6 cm",
        "voxel_size: 0.12, and normal_neighbours: 20",
    ),
    "few points": (
        {"source_points": 250.0},
        "red",
        "a run has 250 source points",
        "subsampling_probability: 0.3",
    ),
    "few of a grid": (
        {"source_points": 600.0, "voxel_size": 0.25, "subsampling_probability": 0.5},
        "remark",
        "a run has 600 source points",
        "voxel_size: 0.2",
    ),
    "few of thin scans": (
        {"source_points": 600.0, "subsampling_probability": 0.9},
        "remark",
        "a run has 600 source points",
        "denser scans",
    ),
    "many points": (
        {"source_points": 31_000.0},
        "remark",
        "a run has 31,000 source points",
        "subsampling_probability: 0.02",
    ),
    "overlap distance below the spacing": (
        {"matched_distance": 0.412},
        "remark",
        "lie within 0.412 m, and overlap_distance is 0.2 m",
        "perturbation: {overlap_distance: 0.42}",
    ),
    "little overlap": ({"overlap": 0.2}, "remark", "the overlap ratio is 0.20", "nearer to each"),
    "more source than reference": ({"overlap": 1.3}, "remark", "ratio is 1.30", "more points as"),
    "duplicates": ({"duplicate_share": 0.15}, "remark", "15.0% of the points", "voxel_size"),
    "a vehicle": (
        {"nearest_return": 2.9},
        "remark",
        "the nearest return is 2.9 m away",
        "a larger minimum_range if",
    ),
    "most within the range": (
        {"removed_share": 0.6},
        "remark",
        "removes 60.0% of the points",
        "a smaller minimum_range",
    ),
    "millimetres": (
        {"typical_range": 3800.0},
        "red",
        "half of the points are within 3,800 m",
        "multiply by 0.001",
    ),
    "another unit": ({"typical_range": 0.004}, "red", "within 0.4 cm", "in metres"),
    "the inverse pose": (
        {"better_pose": ground_truth.INVERSE},
        "red",
        "and nearer with the inverse motion",
        "maps the source's points into the reference's frame",
    ),
    "the transposed rotation": (
        {"better_pose": ground_truth.TRANSPOSED},
        "red",
        "and nearer with the transposed rotation",
        "row-major",
    ),
    "no such pair": ({"median_distance": 2.5}, "red", "within 2.5 m of the reference", "units"),
}


@pytest.mark.parametrize("name", MISFITS)
def test_each_misfit_is_named_and_nothing_else(name):
    changed, grade, sentence, remedy = MISFITS[name]
    fit = fit_table(ONE, **changed)
    (row,) = fit[fit.grade != "fits"].itertuples()
    assert row.grade == grade
    assert sentence in row.sentence
    assert remedy in row.remedy


def test_where_all_fits_there_is_no_remedy_and_nine_numbers():
    fit = fit_table(ONE)
    assert len(fit) == 9
    assert set(fit.grade) == {"fits"} and set(fit.remedy) == {""}
    assert checks.lines(fit, "mine") == ["mine: the settings fit the scans (9 checks)"]
    assert set(checks.marked(ONE, fit).misfit) == {""}


def test_an_estimator_without_normals_is_not_asked_for_them():
    fit = fit_table(ONE, neighbours=np.nan, normal_radius=np.nan, ring_share=np.nan)
    assert {"rings", "normals"}.isdisjoint(fit.check)
    assert "normals" not in set(fit_table(ONE, largest_noise=np.nan).check)


def test_where_it_is_demanded_red_is_an_error_with_its_remedy():
    checks.require_fit(fit_numbers(ONE, overlap=0.2), ("apartment", 0, 1))
    numbers = fit_numbers(ONE, typical_range=3800.0)
    with pytest.raises(DataError, match=r"3,800 m of the scanner\. What may mend it: "):
        checks.require_fit(numbers, ("apartment", 0, 1))


def clean_rows(**changed):
    """Rows of an uncertainty table: clean, again, replicated, perturbed."""
    table = pd.DataFrame(
        {
            "sequence": "apartment",
            "reference": 0,
            "source": 1,
            "sensor_noise": [0.0, 0.0, 0.0, 0.05],
            "again": [False, True, False, False],
            "replicate": [0, 0, 1, 0],
            "n_runs": 100,
            "success_rate": [1.0, 0.1, 0.1, 0.1],
            "no_basin": [False, True, True, True],
            "memory": [0.1, 0.9, 0.9, 0.4],
        }
    )
    return table.assign(**{name: [value, *table[name][1:]] for name, value in changed.items()})


@pytest.mark.parametrize(
    ("changed", "check", "words"),
    [
        ({"success_rate": 0.94}, "clean success", "94% of the clean runs arrive"),
        ({"no_basin": True}, "clean basin", "fewer than half of the clean runs lie together"),
    ],
)
def test_clean_runs_that_do_not_arrive_are_red(changed, check, words):
    numbers = fit_numbers(ONE)
    fit = checks.complete(numbers, clean_rows(**changed), {"sensor_noise": 0.0})
    (row,) = fit[fit.grade != "fits"].itertuples()
    assert (row.check, row.grade) == (check, "red") and words in row.sentence
    marked = checks.marked(shap_table(FIXED, PAIRS), fit)
    assert words in marked.misfit[0].lower() and set(marked.misfit[1:]) == {""}


def test_a_remedy_of_two_rows_is_said_behind_the_second():
    changed = {"success_rate": 0.5, "no_basin": True}
    fit = checks.complete(fit_numbers(ONE), clean_rows(**changed), {"sensor_noise": 0.0})
    (text,) = filter(None, checks.red(fit).values())
    assert text.count("What may mend it") == 1 and text.endswith(f"{checks.AS_ABOVE}.")


def test_runs_that_stop_on_their_way_are_remarked_in_whatever_setting():
    uncertainty = clean_rows()
    uncertainty.loc[3, "memory"] = 0.7
    fit = checks.complete(fit_numbers(ONE), uncertainty, {"sensor_noise": 0.0})
    (row,) = fit[fit.grade != "fits"].itertuples()
    assert (row.check, row.grade) == ("stopping", "remark")
    assert "explains up to 70% of the spread" in row.sentence and "1e-5" in row.remedy


@pytest.mark.parametrize(
    ("stop", "remedy"),
    [
        (1e-3, "stop_rotation: 1e-5, stop_translation: 1e-5"),
        (1e-5, "stop_rotation: 1e-6, stop_translation: 1e-6"),
        (np.nan, "a registration that stops later"),
    ],
)
def test_a_tighter_stop_is_proposed_to_those_that_have_the_option(stop, remedy):
    numbers = fit_numbers(ONE, stop_rotation=stop)
    fit = checks.complete(numbers, clean_rows(memory=0.7), {"sensor_noise": 0.0})
    assert fit.set_index("check").remedy["stopping"] == remedy


def test_clean_runs_that_arrive_fit_and_those_that_do_not_succeed_by_name_are_left_out():
    numbers = fit_numbers(ONE)
    fit = checks.complete(numbers, clean_rows(), {"sensor_noise": 0.0})
    assert set(fit.grade) == {"fits"} and len(fit) == 12
    without = checks.complete(numbers, clean_rows(success_rate=np.nan), {"sensor_noise": 0.0})
    assert "clean success" not in set(without.check)


def test_several_pairs_are_one_line_a_check_of_the_gravest():
    three = shap_table(FIXED, PAIRS)
    fit = fit_table(three, overlap=[0.9, 0.2, 0.3], source_points=[1800.0, 1800.0, 200.0])
    said = checks.lines(fit, "mine")
    assert said[0] == "mine: 7 of 9 checks fit"
    assert said[1].startswith("  RED: A run has 200 source points") and "1 of 3 pairs" in said[1]
    assert said[2].startswith("  remark: The overlap ratio is 0.20") and "2 of 3 pairs" in said[2]
    assert list(checks.by_check(fit).grade[:2]) == ["red", "remark"]


def test_the_tables_have_their_columns(tmp_path):
    tables.write(tmp_path / "numbers.parquet", fit_numbers(ONE), "fit_numbers")
    tables.write(tmp_path / "fit.parquet", fit_table(ONE), "fit")
    assert list(tables.read(tmp_path / "fit.parquet", "fit").check) == list(fit_table(ONE).check)
