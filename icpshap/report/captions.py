"""What a figure or table shows, in sentences: printed under it, in the report and in its files.

Numbers come from the tables, so that a caption never says more than was run. Tables are shap
tables, and studies `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from icpshap.explanation import readings
from icpshap.report import directions, doubts, effects, fit, here, in_doubt, pose_error, words
from icpshap.report.study import contains_zero, judged, pairs_of

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.report.study import Study


ALONE = "One cause has nothing to interact with."
NOTHING_PERTURBED = "Nothing was perturbed."

# --- how the numbers came about -------------------------------------------------------------------


def method(table: pd.DataFrame, study: Study) -> list[str]:
    """Estimator, what it returned, and what the intervals hold for."""
    kept = study.valued(table)
    made = _estimates(table.n_runs.max(), study)
    if len(kept) and kept.n_used.min() < table.n_runs.max():
        made += f", {kept.n_used.min()} or more of them used"
    if len(kept) and study.returns.chain:
        made += f", worth {kept.n_effective.min():.0f} or more independent ones"
    sentences = [f"Estimator {study.estimator}; {made}."]
    sentences += filter(None, [study.estimator_kind.spread(study.noise_draws)])
    if len(kept):
        sentences += [*_intervals(kept, study), *sensor_sensitivity(kept, study)]
    return sentences


def _estimates(number, study):
    """What there is of each setting, of which there are `number`."""
    if study.returns.is_deterministic:
        draws = f" in each of {study.noise_draws} noise draws" * (study.noise_draws > 1)
        return f"one covariance a setting{draws}"
    return f"{number} {'ICP runs' if study.returns.exchangeable else 'samples'} a setting"


def _intervals(kept, study):
    over = study.interval_over(kept)
    if not over:
        return [f"No intervals: {kept.no_interval.iloc[0]}."]
    drawn = _drawn_once(kept, study, over)
    condition = f", conditional on {drawn}" if drawn else ""
    return [f"95 % intervals are taken over {over}{condition}."]


def _drawn_once(table, study, over):
    """The random numbers that all that was left out for the intervals share, "" for none."""
    shown = study.shown(table) if over in ("runs", "noise draws") else ()
    parts: dict[str, list[str]] = {}
    for cause in sorted(shown, key=lambda cause: cause.drawn_once):
        if cause.drawn and (over == "runs" or cause.drawn_once):
            what, of_what = cause.drawn
            parts.setdefault(what, []).append(of_what)
    return words.listed([f"one {what} {words.listed(of)}" for what, of in parts.items()])


def symbols(study: Study) -> list[str]:
    """What f, its unit and φ are, in sentences."""
    return [f"f = {meaning(study)}; φ, the Shapley value of a cause, is its share of f."]


def meaning(study: Study) -> str:
    """Name and unit of f, and what it says."""
    known = readings.READINGS[study.divergence]
    nats = " (a nat is 1.44 bits)" * (known.unit == "nats")
    return f"{reading(study)}{nats}{f' {known.meaning}' * bool(known.meaning)}"


def reading(study: Study) -> str:
    """Name and unit of f, and how it was corrected."""
    known = readings.READINGS[study.divergence]
    corrected = f" with {study.bias_correction} correction" * (study.bias_correction != "none")
    return f"{known.label} [{known.unit}]{corrected}"


def returned(study: Study) -> str:
    """What came back from the estimator, in one sentence."""
    returns = study.returns
    samples = "pose samples, " + (
        "a run each, independent of one another"
        if returns.exchangeable
        else "which depend on one another"
    )
    covariance = "a covariance" + " from each noise draw" * (study.noise_draws > 1)
    both = [samples] * returns.samples + [covariance] * returns.covariances
    return f"Of each setting the kind {study.kind} returned {', and '.join(both)}."


# --- what was found -------------------------------------------------------------------------------


def significance(table: pd.DataFrame, study: Study) -> list[str]:
    """How many Shapley values differ from 0, and how many of the negative ones do."""
    rows_of = {
        f"phi_{cause.name}": judged(study.present(table, cause), f"phi_{cause.name}")
        for cause in study.players
    }
    phi = np.concatenate([rows[name] for name, rows in rows_of.items()])
    significant = np.concatenate([~contains_zero(rows, name) for name, rows in rows_of.items()])
    if len(phi) == 0:
        return []
    text = (
        f"{significant.sum()} of {len(phi)} Shapley values of causes that are on can be "
        "distinguished from zero"
    )
    negative = phi < 0
    if negative.any():
        share = significant[negative].mean()
        text += (
            f"; {negative.sum()} are negative, {significant[negative].sum()} of these "
            f"significantly ({share:.0%})"
        )
    return [text + "."]


def finding(table: pd.DataFrame, directions_table: pd.DataFrame, study: Study) -> str:
    """The main finding of an experiment, after its name and its pairs."""
    told = found(table, directions_table, study)
    return f"{study.name} ({which_pairs(table, study)}{_explained_here(table, study)}): {told}"


def _explained_here(table, study):
    """What is explained of pairs that are diagnosed, after their names; "" of others."""
    known = study.here and len(study.valued(table))
    return f", {here.instances(table, study)}" if known else ""


def found(table: pd.DataFrame, directions_table: pd.DataFrame, study: Study) -> str:
    """The main finding: the pose error, then f; what limits it comes first."""
    error = pose_error.sentence(directions_table, study)
    broken = fit.misfits(table, study)
    known = [error, effects.success(table, study), effects.no_basin(table, study)]
    before = "; ".join(filter(None, known))
    start = f"{broken} As it is: " * bool(broken) + f"{before}. As for f: " * bool(before)
    if len(study.valued(table)) == 0:
        none = here.nothing(table) if study.here else ""
        return " ".join([f"{start}{none or 'no pair has a value'}.", *effects.shares(table, study)])
    rows = {cause: study.present(table, cause) for cause in study.shown(table)}
    rows = {cause: part for cause, part in rows.items() if len(part)}
    if not rows:
        return f"{start}nothing was perturbed."
    shrinking = effects.shrinking(table, study, with_error=not error)
    return f"{start}{'; '.join(filter(None, [shrinking, *_contributions(rows, table, study)]))}."


def _contributions(rows, table, study):
    """What can be told from zero, and which cause is the largest; rows: those where each is on."""
    narrowing = effects.narrowing(table, study)
    judged_by = bool(study.interval_over(table))
    clear, told = {}, {}
    for cause, part in rows.items():
        known = judged(part, f"phi_{cause.name}")
        significant = ~contains_zero(known, f"phi_{cause.name}")
        told[cause] = significant.sum(), len(known)
        # What narrows the spread in some instances may be a source of uncertainty in others.
        narrows = part[f"narrows_{cause.name}"].mean() > effects.MOST
        if not narrows and (not judged_by or significant.sum() > effects.MOST * len(known)):
            clear[cause] = part
    parts = []
    if clear:
        largest = max(clear, key=lambda cause: clear[cause][f"phi_{cause.name}"].median())
        parts = [_largest(largest, clear[largest], study), effects.removal(table, study, largest)]
    elif any(cause not in narrowing for cause in rows):
        which = "other cause" if narrowing else "cause"
        most = " in most instances" * (len(study.valued(table)) > 1)
        parts = [f"no {which} can be told from zero{most}"]
    if judged_by:
        parts.append(_told_from_zero(told))
    else:
        parts.append("there are no intervals")
    return list(filter(None, parts))


def _told_from_zero(told):
    """Which φ can be told from zero; told: of each cause in how many instances, and of how many."""
    if max(number for _, number in told.values()) > 1:
        counts = (f"{c.title} in {some:,} of {number:,}" for c, (some, number) in told.items())
        return f"φ can be told from zero for {', '.join(counts)} instances"
    sure = [cause.title for cause, (some, _) in told.items() if some]
    if not sure:
        return "no φ can be told from zero"
    if len(sure) == len(told):
        return f"{'each ' * (len(told) > 1)}φ can be told from zero"
    return f"φ can be told from zero for {words.listed(sure)} only"


def _largest(cause, rows, study):
    """That a cause has the largest median; rows: those in which it is on."""
    # Where the spread shrinks, f measures a change and not an uncertainty.
    changes = (rows.shrinks | rows[f"narrows_{cause.name}"]).any()
    does = "changes the spread most" if changes else "contributes most to the uncertainty"
    share = _in_median(rows, f"phi_{cause.name}", study)
    return f"{cause.title} {does}, its share of f is φ = {share}"


def _in_median(rows, name, study):
    median = f"{words.number(rows[name].median())} {study.unit}"
    return f"{median} in the median" if len(rows) > 1 else median


# --- what makes it doubtful -----------------------------------------------------------------------


def sensor_sensitivity(table: pd.DataFrame, study: Study) -> list[str]:
    """How far what the sensor's own noise was said to be decides the Shapley values."""
    parts = []
    for cause in study.shown(table) if study.returns.sensor_sigma else ():
        phi = table[f"phi_{cause.name}"]
        twice, half = (
            (table[f"phi_{cause.name}_sensor_sigma_{times}"] - phi).dropna()
            for times in ("twice", "half")
        )
        if len(twice) and len(half):
            of = "" if len(table) == 1 else "in the median "
            parts.append(f"{cause.title} {of}{twice.median():+.2g} and {half.median():+.2g}")
    if not parts:
        return []
    return [
        "With twice and with half of the sensor's own noise φ would change, to first order, by: "
        f"{', '.join(parts)}."
    ]


def noise_floor(table: pd.DataFrame, study: Study) -> list[str]:
    """What f is without any perturbation, by chance alone."""
    kept = study.valued(table)
    again = pairs_of(kept).f_again.dropna()
    if study.returns.drawn and len(again):
        return [
            "A/A value: between two clean samples of a pair, which differ by chance alone, f is "
            f"{words.number(again.median())}{' in the median' * (len(again) > 1)}; the runs of a "
            "draw share its noise, so that there is no noise floor of independent ones."
        ]
    if len(kept) == 0 or kept.null_mean.isna().all():
        return []
    if study.returns.is_deterministic:
        return ["The estimator is deterministic: without a perturbation f is exactly 0."]
    text = (
        f"Noise floor: by chance alone, between independent samples of one distribution, f has "
        f"the mean {kept.null_mean.mean():.2f} and the 95 % quantile {kept.null_95.mean():.2f}"
    )
    if len(again) == 1:
        text += (
            "; between two clean samples of this pair it is "
            f"{words.number(again.iloc[0])} (A/A value)"
        )
    elif len(again):
        text += (
            f"; between two clean samples of a pair it is {words.number(again.median())} in the "
            f"median of {len(again)} pairs, at most {words.number(again.max())} (A/A value)"
        )
    return [text + "."]


# --- captions -------------------------------------------------------------------------------------


def caption(figure: str, table: pd.DataFrame, study: Study) -> str:
    """The caption of a figure by its name, one paragraph: what breaks it first, warnings last."""
    of_chance = noise_floor(table, study) if figure in ("waterfall", "pairs", "drive") else []
    opening = _opening(figure, table, study)
    return _broken_first([opening, *of_all(table, study), *of_chance], table, study)


def _broken_first(sentences, table, study):
    """Sentences as one paragraph, what breaks the answer of a table before all others."""
    broken = fit.misfits(table, study)
    return " ".join(sorted(sentences, key=lambda text: text != broken))


def of_all(table: pd.DataFrame, study: Study) -> list[str]:
    """What every caption says of a table, a page but once; what limits it first, in sentences."""
    return [
        *limits(table, study),
        *symbols(study),
        *method(table, study),
        *significance(table, study),
        *effects.shares(table, study),
        *no_wrong_basin(table, study),
        *doubts.warnings(table, study),
    ]


def no_wrong_basin(table: pd.DataFrame, study: Study) -> list[str]:
    """That no run ended in a wrong basin, where that is so; else it is a doubt."""
    kept = study.valued(table)
    if len(kept) == 0 or not study.returns.samples or kept.n_wrong_basin.max() > 0:
        return []
    return [f"No {study.repeats.removesuffix('s')} ended in a wrong basin."]


def of_directions(table: pd.DataFrame, shap: pd.DataFrame, study: Study) -> str:
    """The caption of the figure of directions; shap: the shap table beside the directions table."""
    if not study.shown(shap):
        return NOTHING_PERTURBED
    shown = directions.chosen(shap, study)
    opening = (
        "Variance along the axes of the reference, at the origin of the source scanner, in all and "
        "along the weakest direction, and the mean squared error: clean, what each cause adds "
        f"(Shapley values), and with all causes on, {which_pairs(shown, study)} "
        f"{which_instances(shown, study)}{', medians' * (len(shown) > 1)}. Numbers are squares of "
        "the unit that a row names; behind an arrow the standard deviation or root mean square "
        "error that remains without a cause; the last column is that of the clean setting and with "
        "all causes on. A ring marks what cannot be told from zero: most 95 % intervals contain 0. "
        "Along the weakest direction a rotation counts as what it moves at the pair's "
        "characteristic length."
    )
    told = directions.sentences(table, study)
    sentences = [opening, *told, *limits(shown, study), *method(shap, study)]
    return _broken_first(sentences, shown, study)


def limits(table: pd.DataFrame, study: Study) -> list[str]:
    """What must be known before any number is read, in sentences."""
    found = (
        fit.misfits(table, study).removesuffix("."),
        effects.no_basin(table, study),
        effects.shrinking(table, study),
    )
    return [f"{text[0].upper()}{text[1:]}." for text in found if text]


def _opening(figure, table, study):
    if not study.shown(table):
        return NOTHING_PERTURBED
    if figure in study.dependence_figures:
        cause, other = study.dependence_figures[figure]
        return _dependence(cause, other, table, study)
    return OPENINGS[figure](table, study)


def which_pairs(table: pd.DataFrame, study: Study) -> str:
    """The pairs of a table in words."""
    pairs = pairs_of(table)
    if len(pairs) == 1:
        return study.pair(next(pairs.itertuples()))
    names = ", ".join(study.title(sequence) for sequence in pairs.sequence.unique())
    explained = len(pairs_of(study.valued(table))) if study.here else len(pairs)
    some = f"{explained} of " * (0 < explained < len(pairs))
    return f"{some}{len(pairs)} pairs of {names}"


def which_instances(table: pd.DataFrame, study: Study) -> str:
    """The perturbations of a table in words."""
    shown = study.shown(table)
    if study.here:
        return here.instances(table, study)
    levels = table[[cause.name for cause in shown]].drop_duplicates()
    if len(levels) == 1:
        return f"at {words.describe_values(levels.iloc[0], shown)}"
    ranges = (
        f"{c.title} {c.symbol} {levels[c.name].min():g} to {levels[c.name].max():g}" for c in shown
    )
    return f"for {len(levels)} perturbations ({', '.join(ranges)})"


def _summary(table, study):
    text = (
        f"Shapley values of the causes, {which_pairs(table, study)} "
        f"{which_instances(table, study)}; a dot is an instance in which the cause is on."
    )
    if study.interval_over(table):
        text += " Counts say how many of the values can be distinguished from zero (≠ 0)."
    return text + words.axis(study.valued(table)[study.phi(table)])


def _waterfall(table, study):
    text = (
        f"What f = {words.number(table.f.iloc[0])} {study.unit} is made of, "
        f"{which_pairs(table, study)} at "
        f"{words.describe_values(table.iloc[0], study.shown(table))}."
    )
    if study.interval_over(table):
        text += (
            " Black lines are 95 % intervals of the Shapley values, put where the arrow ends; a "
            "hatched arrow cannot be distinguished from zero."
        )
    if effects.narrowing(table, study):
        text += " A green arrow is that of a cause which narrows the spread."
    parts = [
        f"{cause.title} {words.of_rows(table, f'removal_{cause.name}')}"
        for cause in study.shown(table)
        if len(study.valued(table))
    ]
    if parts:
        text += f" Without a cause f falls by: {', '.join(parts)} {study.unit}."
    return text


def _dependence(cause, other, table, study):
    marks = bool(study.interval_over(table))
    text = (
        f"Shapley value of {cause.title} over its own value, coloured by {other.title}, "
        f"{which_pairs(table, study)} {which_instances(table, study)}. Each level has a lane, in "
        f"which dots are set side by side by {other.title}; the line is their median, "
        f"{'' if marks else 'and '}the grey box holds the central 90 %"
    )
    if marks:
        text += (
            ", and the bars are the median lower and upper ends of the 95 % intervals. Open dots "
            "cannot be distinguished from zero"
        )
    return f"{text}.{words.axis(study.valued(table)[f'phi_{cause.name}'])}"


def _interactions(table, study):
    where = f"{which_pairs(table, study)} {which_instances(table, study)}"
    one = len(table) == 1
    contain = "the 95 % interval contains 0" if one else "most 95 % intervals contain 0"
    ring = f" A ring marks a cell of which {contain}." * bool(study.interval_over(table))
    value = "Shapley value" if one else "median Shapley value"
    if len(study.shown(table)) == 1:
        return f"{value[0].upper()}{value[1:]}, {where}. {ALONE}{ring}"
    medians = "" if one else ": medians over the instances in which both are on"
    return (
        f"Shapley interaction indices of every two causes, {where}{medians}; on the diagonal the "
        f"{value} of the cause itself.{ring} "
        "Below 0, two causes together add less than the sum of what each adds alone. Some of that "
        "is arithmetic: where covariances simply add up and each cause alone makes the variance "
        f"four times as large, the logarithm alone gives {additive_interaction(3.0):+.2f} nats "
        "of interaction to a KL divergence in 6 dimensions."
    )


def _pairs(table, study):
    text = (
        f"Shapley values and f of every pair, {which_pairs(table, study)} "
        f"{which_instances(table, study)}"
    )
    if study.interval_over(table):
        text += ", with 95 % intervals; open dots cannot be distinguished from zero"
    return (
        f"{text}. Coloured lines are medians of a sequence, before any outlier is removed."
        f"{words.AXIS * words.is_spread(table[[*study.phi(table), 'f']])}"
    )


def _drive(table, study):
    error = "pose error (root mean square), the share W of " if study.returns.samples else ""
    wrong = "runs that failed or ended in a wrong basin, " if study.returns.samples else ""
    shaded = "; shaded are 95 % intervals" * bool(study.interval_over(table))
    text = (
        f"Along the drive: {error}{wrong}f, and the Shapley values of the causes, by the source "
        f"scan, {which_pairs(table, study)} {which_instances(table, study)}{shaded}. "
        f"{words.AXIS.strip() * words.is_spread(table[[*study.phi(table), 'f']])}"
    )
    ranks = in_doubt.ranking(table, study)
    if len(ranks):
        named = ", ".join(f"{row.reference}–{row.source}" for row in ranks.itertuples())
        text += (
            f" Stripes mark the pairs most in doubt, with their rank: {in_doubt.how(study)}. In "
            f"that order they are {named}; the table beside the figure has their numbers."
        )
    missing = table.reason != ""
    if missing.any():
        text += f" {missing.sum()} of {len(table)} pairs were not registered (crosses)."
    return " ".join(text.split())


OPENINGS = {
    "summary": _summary,
    "waterfall": _waterfall,
    "interactions": _interactions,
    "pairs": _pairs,
    "drive": _drive,
}


def additive_interaction(factor: float) -> float:
    """Interaction [nats] of two causes whose covariances add up: clean I, each adds factor I.

    Nothing interacts in the covariances, yet the logarithm makes f subadditive.
    """
    clean = np.eye(readings.DIMENSION)
    f = [readings.kullback_leibler(clean, (1 + k * factor) * clean) for k in range(3)]
    return float(f[2] - 2 * f[1] + f[0])
