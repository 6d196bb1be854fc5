"""Captions, findings and warnings say what the tables hold, and no more."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from known_results import (
    OF_NUMBER,
    STUDY,
    THREE,
    fixed_of,
    grid_of,
    of_covariances,
    study_of,
    without_intervals,
    without_value,
)

from icpshap import estimators, tables
from icpshap.report import captions, doubts, effects

DRAWS = "one draw of the sensor noise and of the removed points"
ABOUT_INTERVALS = ("significant", "distinguished", "told from zero", "95 %", "interval")
ABOUT_RUNS = ("ICP run", " run ", "runs", "basin")


def finding(table, study):
    """What is found of f alone, without the pose error."""
    return captions.finding(table, tables.empty("directions", study.causes), study)


def on(table, name):
    cause = next(c for c in STUDY.players if c.name == name)
    return STUDY.present(table, cause)


def test_caption_says_what_intervals_hold_for(grid):
    assert f"95 % intervals are taken over runs, conditional on {DRAWS}." in (
        captions.caption("summary", grid, STUDY)
    )
    text = captions.caption("summary", grid.assign(interval_over="replicates"), STUDY)
    assert "95 % intervals are taken over replicates." in text
    text = captions.caption("summary", grid.assign(interval_over="noise draws"), STUDY)
    assert "taken over noise draws, conditional on one draw of the removed points." in text


def test_intervals_are_conditional_on_the_draws_of_the_causes_that_are_on():
    for names, expected in (
        (THREE[:1], "over runs, conditional on one draw of the sensor noise."),
        (THREE[1:2], "over runs."),
        (
            ("under_constrained", "motion"),
            "draw of the motion distortion and of the removed points",
        ),
    ):
        study = study_of(names)
        assert expected in captions.caption("summary", grid_of(study.causes), study)


def test_a_sector_of_one_draw_is_one_azimuth(grid):
    study = study_of(THREE, variants={"partial_overlap": {"overlap_shape": "sector"}})
    text = captions.caption("summary", grid, study)
    drawn = "one draw of the sensor noise and one azimuth of the removed sector"
    assert f"taken over runs, conditional on {drawn}." in text
    text = captions.caption("summary", grid.assign(interval_over="noise draws"), study)
    assert "taken over noise draws. " in text


def test_the_level_of_a_scanner_is_a_factor(grid):
    study = study_of(THREE, variants={"sensor_noise": {"sensor": "hokuyo_utm_30lx"}})
    row = grid[grid.sensor_noise == 0.1].iloc[:1]
    assert "at sensor noise σ/σ₀ = 0.1." in captions.caption("waterfall", row, study)
    assert "at sensor noise σ = 0.1 m." in captions.caption("waterfall", row, study_of(THREE))


def test_caption_counts_negative_values(grid):
    phi = pd.concat([on(grid, name)[f"phi_{name}"] for name in THREE])
    significant = (phi.abs() > 0.5).sum()
    negative, below = (phi < 0).sum(), (phi < -0.5).sum()
    (sentence,) = captions.significance(grid, STUDY)
    assert sentence.startswith(f"{significant} of {len(phi)} Shapley values of causes that are on")
    assert f"{negative} are negative, {below} of these significantly" in sentence


def test_a_value_without_interval_is_not_counted(grid):
    (before,) = captions.significance(grid, STUDY)
    row = on(grid, "sensor_noise").index[0]
    grid.loc[row, ["phi_sensor_noise_low", "phi_sensor_noise_high"]] = np.nan
    (after,) = captions.significance(grid, STUDY)
    number = sum(len(on(grid, name)) for name in THREE)
    assert f"of {number} Shapley" in before and f"of {number - 1} Shapley" in after


def test_noise_floor_sentence(grid):
    (sentence,) = captions.noise_floor(grid, STUDY)
    assert "mean 0.23 and the 95 % quantile 0.37" in sentence
    assert "between two clean samples of this pair it is 0.30 (A/A value)" in sentence
    assert captions.noise_floor(grid.assign(null_mean=np.nan), STUDY) == []


def test_additive_variances_interact_by_the_logarithm_alone():
    def f(variance):
        return 6 * 0.5 * (1 / variance - 1 + np.log(variance))

    assert captions.additive_interaction(3.0) == pytest.approx(f(7) - 2 * f(4) + f(1))
    assert captions.additive_interaction(3.0) < 0


def with_phi(table, name, value, clear):
    half = 0.5 if clear else abs(value) + 0.5
    ends = {"": value, "_low": value - half, "_high": value + half}
    return table.assign(**{f"phi_{name}{end}": number for end, number in ends.items()})


def test_finding_names_the_largest_cause(fixed):
    for name, value in zip(THREE, (1.0, 5.0, 2.0), strict=True):
        fixed = with_phi(fixed, name, value, clear=True)
    text = finding(fixed, STUDY)
    most = "contributes most to the uncertainty, its share of f is φ = 5.00 nats in the median"
    assert f"initial pose scale {most}" in text
    assert "an_experiment (3 pairs of Apartment, ETH)" in text
    unclear = with_phi(fixed, "initial_pose", 5.0, clear=False)
    assert "partial overlap contributes most" in finding(unclear, STUDY)
    for name in THREE:
        unclear = with_phi(unclear, name, 1.0, clear=False)
    assert "no cause can be told from zero in most instances" in finding(unclear, STUDY)
    nothing = without_value(fixed, fixed.index, "too little overlap")
    assert ": no pair has a value. Share of runs" in finding(nothing, STUDY)


@pytest.mark.parametrize("number", OF_NUMBER)
def test_sentences_name_every_cause_that_is_on_and_no_other(number):
    study = study_of(OF_NUMBER[number])
    table = fixed_of(study.causes)
    told = finding(table, study) + captions.caption("summary", table, study)
    for cause in study.players:
        assert cause.title in told and f"{cause.symbol} = " in told
    if number > 1:
        never = study.players[-1]
        table = table.assign(**{never.name: never.off})
        told = finding(table, study) + captions.caption("summary", table, study)
        assert never.title not in told and f"{never.symbol} = " not in told


def test_nothing_on_is_said():
    table = fixed_of(THREE[:1]).assign(sensor_noise=0.0)
    study = study_of(THREE[:1])
    assert finding(table, study).endswith("nothing was perturbed.")
    assert captions.caption("summary", table, study).startswith("Nothing was perturbed.")


# --- other estimators -----------------------------------------------------------------------------


def everything_said(table, study):
    instance = study.instance(table, study.waterfall)
    texts = [captions.caption(name, table, study) for name in ("summary", "interactions", "pairs")]
    texts += [captions.caption(name, table, study) for name in study.dependence_figures]
    texts += [captions.caption("waterfall", instance, study), finding(table, study)]
    return " ".join([*texts, *doubts.warnings(table, study)])


def test_a_covariance_is_neither_a_run_nor_random(grid):
    study = study_of(THREE, kind="closed_form")
    table = of_covariances(grid).assign(n_failed=0)
    text = everything_said(table, study)
    assert "; one covariance a setting." in text
    why = "the estimator is deterministic, and there is one noise draw: nothing varies"
    assert f"No intervals: {why}." in text
    assert "φ = " in text and "there are no intervals." in text
    told = text.replace("there are no intervals", "").replace(f"No intervals: {why}", "")
    for word in (*ABOUT_INTERVALS, *ABOUT_RUNS, "Noise floor", "A/A", "nan"):
        assert word not in told, word


def test_covariances_of_several_noise_draws_have_intervals(grid):
    study = study_of(THREE, kind="closed_form", noise_draws=10)
    table = of_covariances(grid, 10).assign(n_used=8, n_failed=2)
    text = everything_said(table, study)
    assert "one covariance a setting in each of 10 noise draws, 8 or more of them used." in text
    assert "95 % intervals are taken over noise draws, conditional on one draw of the" in text
    assert "have noise draws that failed, at most 2 of 10" in text
    for word in ABOUT_RUNS:
        assert word not in text, word


def test_a_deterministic_estimator_has_no_noise_floor_and_says_so_once(grid):
    study = study_of(THREE, kind="closed_form")
    table = of_covariances(grid)
    exact = "The estimator is deterministic: without a perturbation f is exactly 0."
    assert captions.noise_floor(table, study) == [exact]
    instance = study.instance(table, study.waterfall)
    assert captions.caption("waterfall", instance, study).count(exact) == 1
    # A reading that does not compare with the clean setting has no null, and is not 0 there.
    assert captions.noise_floor(table.assign(null_mean=np.nan), study) == []


def test_samples_that_depend_on_one_another_are_no_runs(grid):
    study = study_of(THREE, kind="particles")
    reason = "the estimator's samples depend on one another, and there is one noise draw"
    table = without_intervals(grid, reason).assign(null_mean=np.nan, null_95=np.nan, f_again=np.nan)
    text = everything_said(table.assign(n_wrong_basin=3), study)
    assert "100 samples a setting" in text and f"No intervals: {reason}." in text
    assert "Samples in a wrong basin" in text and "without such samples" in text
    for word in ("run", "Run", "Noise floor", *ABOUT_INTERVALS[:3]):
        assert word not in text, word


@pytest.mark.parametrize(
    "kind, draws, sentence",
    [
        ("monte_carlo", 1, "pose samples, a run each, independent of one another."),
        ("particles", 1, "pose samples, which depend on one another."),
        ("closed_form", 1, "a covariance."),
        ("closed_form", 10, "a covariance from each noise draw."),
    ],
)
def test_what_came_back_is_said(kind, draws, sentence):
    said = captions.returned(study_of(THREE, kind=kind, noise_draws=draws))
    assert said == f"Of each setting the kind {kind} returned {sentence}"


def test_one_cause_has_nothing_to_interact_with():
    study = study_of(THREE[:1])
    text = captions.caption("interactions", grid_of(study.causes), study)
    assert text.startswith("Median Shapley value, Apartment 6–7")
    assert captions.ALONE in text and "indices" not in text


def test_what_shrinks_is_said_first_and_is_no_source_of_uncertainty(grid):
    narrow = grid.assign(
        shrinks=True,
        narrows_sensor_noise=grid.sensor_noise > 0,
        phi_sensor_noise=90.0 * (grid.sensor_noise > 0),
        entropy_difference=-7.0,
        clean_translation_rmse=0.175,
        translation_rmse=0.052,
    )
    text = finding(narrow, STUDY)
    first, rest = text.split(": ", 1)[1].split("; ", 1)
    assert first.startswith("the spread shrinks in 18 of 18 instances (half the log determinant")
    assert "translation RMSE from 18 to 5.2 cm" in first
    assert rest.startswith("sensor noise narrows the spread and is no source of uncertainty")
    assert "sensor noise contributes" not in text and "sensor noise changes" not in text
    caption = captions.caption("waterfall", STUDY.instance(narrow, STUDY.waterfall), STUDY)
    assert "green arrow" in caption and "no source of uncertainty" in caption


def test_what_narrows_in_some_instances_is_not_called_a_source_of_uncertainty():
    table = fixed_of(THREE)
    columns = {
        "phi_sensor_noise": 89.0,
        "phi_sensor_noise_low": 80.0,
        "phi_sensor_noise_high": 99.0,
    }
    first = table.index == table.index[0]
    text = finding(table.assign(**columns, narrows_sensor_noise=first), STUDY)
    of = f"1 of {len(table)}"
    assert (
        f"sensor noise narrows the spread in {of} instances and is no source of uncertainty there"
        in text
    )
    assert "sensor noise changes the spread most, its share of f is φ = 89.00 nats" in text
    assert "contributes" not in text


def test_a_removal_that_cannot_be_told_from_zero_says_so():
    table = fixed_of(THREE)
    for name, phi, removal in zip(THREE, (5.0, 6.0, 1.0), (2.0, 7.0, 0.0), strict=True):
        wide = 10 * (name == "initial_pose")
        for column, value in ((f"phi_{name}", phi), (f"removal_{name}", removal)):
            ends = {"": value, "_low": value - 0.5 - wide, "_high": value + 0.5 + wide}
            table = table.assign(**{f"{column}{end}": number for end, number in ends.items()})
    text = finding(table, STUDY)
    assert "sensor noise contributes most" in text
    assert (
        "but removing initial pose scale lowers f most, by 7.00 nats in the median (cannot be told "
        "from zero), removing sensor noise by 2.00"
    ) in text


def test_shares_of_wrong_basins_are_told_where_f_is_not_known():
    table = without_value(fixed_of(THREE), fixed_of(THREE).index, "too few runs")
    table = table.assign(wrong_basin_share=0.45, wrong_basin_initial_pose=0.225)
    text = finding(table, STUDY)
    assert "no pair has a value. Share of runs that failed or ended in a wrong basin" in text
    assert "45.00 % in the median with all causes on" in text
    assert "| 22.50 % " in effects.table_of_causes(table, STUDY, "pipe")


def test_a_setting_without_a_basin_is_said_first(grid):
    text = finding(grid.assign(no_basin=grid.sensor_noise > 0), STUDY)
    assert text.split(": ", 1)[1].startswith("in 12 of 18 instances fewer than half of the runs")


def test_phi_and_removal_are_both_said_where_their_first_ranks_differ():
    table = fixed_of(THREE)
    for name, phi, removal in zip(THREE, (9.0, 1.0, 2.0), (1.0, 2.0, 4.0), strict=True):
        table = table.assign(**{f"phi_{name}": phi, f"removal_{name}": removal})
        table = table.assign(**{f"phi_{name}_low": 0.5, f"phi_{name}_high": 10.0})
    text = finding(table, STUDY)
    most = "contributes most to the uncertainty, its share of f is φ = 9.00 nats"
    assert f"sensor noise {most}" in text
    assert "removing partial overlap lowers f most, by 4.00 nats in the median" in text
    assert "removing sensor noise by 1.00 nats" in text
    same = finding(table.assign(removal_sensor_noise=9.0), STUDY)
    assert "removing" not in same


def test_the_sensors_own_noise_is_said_with_how_it_was_made_and_what_it_decides(grid):
    own = {"sensor_sigma": 0.01, "sensor_noise_by": "draws"}
    for cause in ("sensor_noise", "initial_pose", "partial_overlap"):
        grid[f"phi_{cause}_sensor_sigma_twice"] = grid[f"phi_{cause}"] - 1.5
        grid[f"phi_{cause}_sensor_sigma_half"] = grid[f"phi_{cause}"] + 2.5
    text = " ".join(captions.method(grid, replace(STUDY, options=own, noise_draws=10)))
    assert "white noise of 1 cm for the sensor's own, drawn on both scans" in text
    assert "an upper bound" in text
    assert "with half of the sensor's own noise φ would change, to first order, by: sensor" in text
    assert "sensor noise in the median -1.5 and +2.5" in text
    own["sensor_noise_by"] = "closed_form"
    text = " ".join(captions.method(grid, replace(STUDY, options=own)))
    assert "told 1 cm and of the setting's sensor noise" in text and "a lower bound" in text
    text = " ".join(captions.method(grid, STUDY))
    assert "what the sensor's own noise adds to it is left out" in text
    assert "half of the sensor's own" not in text


@pytest.mark.parametrize("kind", list(estimators.KINDS.values()))
def test_every_kind_says_what_its_spread_is_made_of(kind):
    required = {"register": "icpshap.registrations:small_gicp"} if kind.name == "callable" else {}
    said = kind(**required).spread(1)
    assert said.endswith(".") and len(said) > 40


def test_of_a_registration_that_is_not_ours_success_is_told_first(grid):
    options = {"register": "icpshap.registrations:small_gicp"}
    study = replace(STUDY, kind="callable", estimator="small_gicp", options=options)
    told = "small_gicp ends within 0.1 m and 2 degrees of the true pose in 100 % of its runs clean "
    told += "and 97 % with all causes on, in the median"
    assert finding(grid, study).split(": ", 1)[1].startswith(told)
    nothing = without_value(grid, grid.index, "")
    assert told in finding(nothing, study)
    assert "ends within" not in finding(grid, STUDY)


def test_symbols_are_explained_in_captions(grid):
    (told,) = captions.symbols(STUDY)
    assert told == (
        "f = KL(clean, perturbed) [nats] (a nat is 1.44 bits) says how far the spread of the "
        "results is from that of the clean pair, 0 where it is equal; φ, the Shapley value of a "
        "cause, is its share of f."
    )
    assert told in captions.caption("summary", grid, STUDY)
    (told,) = captions.symbols(replace(STUDY, divergence="wrong_basin_share"))
    assert "[of 1] is how often a run fails" in told
