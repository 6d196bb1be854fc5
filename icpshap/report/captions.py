"""What a figure or table shows, in sentences: printed under it, in the report and in its files.

Numbers come from the tables, so that a caption never says more than was run.
"""

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from icpshap.causes import NAMES, SOURCES
from icpshap.explanation import readings as divergence

# Values beyond this, which a few runs in a wrong basin can cause, get a logarithmic axis.
HUGE = 1000
DRAWS = "one draw of the sensor noise and of the removed points"


@dataclass(frozen=True)
class Study:
    """How the numbers of an experiment came about; config keys, but for `name`, its own.

    `waterfall` is the instance shown alone; `titles` maps keys of sequences to their names.
    """

    name: str
    estimator: str
    divergence: str
    noise_draws: int
    bias_correction: str
    wrong_basins: str
    titles: dict = field(default_factory=dict)
    waterfall: dict | None = None

    @property
    def unit(self):
        return divergence.READINGS[self.divergence].unit

    def title(self, sequence):
        return self.titles.get(sequence, sequence)

    def pair(self, row):
        """Name of the pair of scans in a row of a table."""
        return f"{self.title(row.sequence)} {row.reference}–{row.source}"


def valued(table):
    """The rows of a shap table that have values: registered, and with enough runs left."""
    return table[table[[f"phi_{name}" for name in NAMES]].notna().all(axis=1)]


def present(table, source):
    """The valued rows in which a source is on; where it is off, its phi is 0 by construction."""
    return valued(table[table[source.name] != source.off])


def instance(table, values):
    """The rows of one instance, given by a value for each source."""
    return table[np.all([np.isclose(table[name], values[name]) for name in NAMES], axis=0)]


def number(value):
    """A value as text, with two decimals unless it is very large."""
    return f"{value:.2f}" if abs(value) < 1000 else f"{value:.3g}"


def is_huge(values):
    return np.size(values) > 0 and np.nanmax(np.abs(values)) > HUGE


def axis(values):
    """What an axis for such values is like, where it is not plain."""
    return " The axis is linear up to 1 and logarithmic beyond." * bool(is_huge(values))


def interval(low, high):
    return f"[{number(low)}, {number(high)}]"


def describe_values(values):
    """One perturbation in symbols, as in 'σ = 0.05 m, s = 1.5, λ = 0.05'."""
    parts = (f"{s.symbol} = {values[s.name]:g}" + (f" {s.unit}" if s.unit else "") for s in SOURCES)
    return ", ".join(parts)


# --- sentences ------------------------------------------------------------------------------------


def method(table, study):
    """Estimator, runs and what the intervals hold for."""
    kept = valued(table)
    runs = f"{table.n_runs.max()} ICP runs a setting"
    if len(kept) and kept.n_used.min() < table.n_runs.max():
        runs += f", {kept.n_used.min()} or more of them used"
    sentences = [f"Estimator {study.estimator}; f = {reading(study)}; {runs}."]
    over = kept.interval_over.iloc[0] if len(kept) else ""
    if over:
        drawn_once = {"runs": DRAWS, "noise draws": "one draw of the removed points"}
        condition = f", conditional on {drawn_once[over]}" if over in drawn_once else ""
        sentences.append(f"95 % intervals are taken over {over}{condition}.")
    return sentences


def reading(study):
    known = divergence.READINGS[study.divergence]
    corrected = f" with {study.bias_correction} correction" * (study.bias_correction != "none")
    return f"{known.label} [{known.unit}]{corrected}"


def significance(table):
    """How many Shapley values differ from 0, and how many of the negative ones do."""
    phi, significant = [], []
    for source in SOURCES:
        rows = present(table, source)
        phi.append(rows[f"phi_{source.name}"])
        significant.append(rows[f"phi_{source.name}_significant"])
    phi, significant = np.concatenate(phi), np.concatenate(significant).astype(bool)
    if len(phi) == 0:
        return []
    text = (
        f"{significant.sum()} of {len(phi)} Shapley values of sources that are on can be "
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


def basins(table, study):
    """How many runs end in a wrong basin, and what the Shapley values are with and without them."""
    kept = valued(table)
    if len(kept) == 0:
        return []
    most, runs = kept.n_wrong_basin.max(), kept.n_runs.max()
    if most == 0:
        return ["No run ended in a wrong basin."]
    done = {"keep": "kept", "leave_out": "left out"}[study.wrong_basins]
    sentences = [
        "Runs that end in a wrong basin in at least one setting of an instance: "
        f"{kept.n_wrong_basin.median():.0f} of {runs} in the median, at most {most}; {done}."
    ]
    both = kept[kept.f_right_basin.notna()]
    if len(both):
        parts = (
            f"{source.title} {number(rows[f'phi_{source.name}_all'].median())} and "
            f"{number(rows[f'phi_{source.name}_right_basin'].median())}"
            for source in SOURCES
            for rows in [present(both, source)]
            if len(rows)
        )
        where = "" if len(both) == len(kept) else f" of the {len(both)} instances that allow it"
        sentences.append(f"Median φ{where} with and without such runs: {', '.join(parts)}.")
    if len(both) < len(kept):
        sentences.append(
            f"For {len(kept) - len(both)} of {len(kept)} instances too few runs are left "
            "without them."
        )
    return sentences


def floor_sensitivity(table):
    """How far the covariance floor decides the Shapley values, where a warning is about it."""
    doubtful = valued(table[table.warning.str.contains("of the clean variance")])
    if len(doubtful) == 0:
        return []
    parts = []
    for source in SOURCES:
        phi = doubtful[f"phi_{source.name}"]
        changes = (
            (doubtful[f"phi_{source.name}_floor_{floor}"] - phi).abs().max()
            for floor in ("tenfold", "tenth")
        )
        tenfold, tenth = changes
        parts.append(f"{source.title} {tenfold:.2g} and {tenth:.2g}")
    return [
        "With ten times and with a tenth of the covariance floor φ changes by at most: "
        f"{', '.join(parts)}."
    ]


def noise_floor(table):
    """What f is without any perturbation, by chance alone."""
    kept = valued(table)
    if len(kept) == 0 or kept.null_mean.isna().all():
        return []
    text = (
        f"Noise floor: f between independent samples of one distribution has the mean "
        f"{kept.null_mean.mean():.2f} and the 95 % quantile {kept.null_95.mean():.2f}"
    )
    again = kept.drop_duplicates(["sequence", "reference", "source"]).f_again.dropna()
    if len(again) == 1:
        text += f"; between two clean samples of this pair it is {number(again.iloc[0])} (A/A)"
    elif len(again):
        text += (
            f"; between two clean samples of a pair it is {number(again.median())} in the "
            f"median of {len(again)} pairs, at most {number(again.max())} (A/A)"
        )
    return [text + "."]


def warnings(table, study):
    """Pairs that were excluded and why, and what makes the others doubtful; a line each."""
    lines = []
    pairs = table.drop_duplicates(["sequence", "reference", "source"])
    excluded = [f"{study.pair(row)} ({row.reason})" for row in pairs.itertuples() if row.reason]
    if excluded:
        lines.append(f"Not registered: {', '.join(excluded)}.")
    doubtful = table[table.warning != ""]
    for warning, rows in doubtful.groupby("warning", sort=False):
        names = [study.pair(row) for row in rows.drop_duplicates(list(pairs)[:3]).itertuples()]
        where = ", ".join(names) if len(names) <= 4 else f"{len(names)} pairs"
        lines.append(f"{where} ({len(rows)} instance{'s' * (len(rows) > 1)}): {warning}.")
    lines += floor_sensitivity(table)
    unsettled = valued(pairs)[lambda rows: rows.f_again > rows.null_95]
    if len(unsettled):
        lines.append(
            f"In {len(unsettled)} of {len(valued(pairs))} pairs two clean samples differ by more "
            f"than the noise floor, f = {number(unsettled.f_again.max())} {study.unit} at most: an "
            "f of that size need not come from any uncertainty source."
        )
    failed = table[table.n_failed > 0]
    if len(failed):
        lines.append(
            f"{len(failed)} instances have runs that failed, at most {failed.n_failed.max()} of "
            f"{failed.n_runs.max()}; these are left out of all of the instance's settings."
        )
    without = len(table[table.reason == ""]) - len(valued(table))
    if without:
        lines.append(f"{without} instances have no value: too few runs were left.")
    return lines


def finding(table, study):
    """The main finding of an experiment in one sentence."""
    where = f"{study.name} ({_which_pairs(table, study)})"
    kept = valued(table)
    if len(kept) == 0:
        return f"{where}: no pair has a value."
    medians, told = {}, []
    for source in SOURCES:
        rows = present(table, source)
        if len(rows):
            significant = rows[f"phi_{source.name}_significant"].astype(bool)
            told.append(f"{source.title} in {significant.sum():,} of {len(rows):,}")
            if significant.mean() > 0.5:
                medians[source.title] = rows[f"phi_{source.name}"].median()
    if not told:
        return f"{where}: nothing was perturbed."
    share = f"φ can be told from zero for {', '.join(told)} instances"
    if not medians:
        return f"{where}: no uncertainty source can be told from zero in most instances; {share}."
    largest = max(medians, key=medians.get)
    return (
        f"{where}: {largest} contributes most to the uncertainty, φ = {number(medians[largest])} "
        f"{study.unit} in the median; {share}."
    )


def additive_interaction(factor):
    """Interaction [nats] of two sources whose covariances add up: clean I, each adds factor I.

    Nothing interacts in the covariances, yet the logarithm makes f subadditive.
    """
    clean = np.eye(divergence.DIMENSION)
    f = [divergence.kullback_leibler(clean, (1 + k * factor) * clean) for k in range(3)]
    return float(f[2] - 2 * f[1] + f[0])


# --- captions -------------------------------------------------------------------------------------


def caption(figure, table, study):
    """The caption of a figure by its name, as one paragraph; warnings come last."""
    opening = OPENINGS[figure.split("_")[0]](figure, table, study)
    sentences = [*opening, *method(table, study), *significance(table)]
    if figure in ("waterfall", "pairs"):
        sentences += noise_floor(table)
    return " ".join([*sentences, *basins(table, study), *warnings(table, study)])


def _which_pairs(table, study):
    pairs = table.drop_duplicates(["sequence", "reference", "source"])
    if len(pairs) == 1:
        return study.pair(next(pairs.itertuples()))
    names = ", ".join(study.title(sequence) for sequence in pairs.sequence.unique())
    return f"{len(pairs)} pairs of {names}"


def _which_instances(table):
    levels = table[list(NAMES)].drop_duplicates()
    if len(levels) == 1:
        return f"at {describe_values(levels.iloc[0])}"
    ranges = (f"{s.symbol} {levels[s.name].min():g} to {levels[s.name].max():g}" for s in SOURCES)
    return f"for {len(levels)} perturbations ({', '.join(ranges)})"


def _summary(_, table, study):
    return [
        f"Shapley values of the uncertainty sources, {_which_pairs(table, study)} "
        f"{_which_instances(table)}; a dot is an instance. Counts are of the instances in which "
        "a source is on: how many of its values can be distinguished from zero."
        + axis(valued(table)[[f"phi_{name}" for name in NAMES]])
    ]


def _waterfall(_, table, study):
    return [
        f"What f = {number(table.f.iloc[0])} {study.unit} is made of, "
        f"{_which_pairs(table, study)} at "
        f"{describe_values(table.iloc[0])}. Black lines are 95 % intervals of the Shapley values, "
        "put where the arrow ends; a hatched arrow cannot be distinguished from zero."
    ]


def _dependence(figure, table, study):
    source, other = dependence_sources(figure)
    return [
        f"Shapley value of {source.title} over its own value, coloured by {other.title}, "
        f"{_which_pairs(table, study)} {_which_instances(table)}. Within a level, dots are "
        f"set side by side by {other.symbol}; the line is their median, the band holds the "
        "central 90 %, and the bars are the median lower and upper ends of the 95 % intervals. "
        "Open dots cannot be distinguished from zero." + axis(valued(table)[f"phi_{source.name}"])
    ]


def _interactions(_, table, study):
    return [
        f"Shapley interaction indices, {_which_pairs(table, study)} {_which_instances(table)}. "
        "Below 0, two sources together add less than the sum of what each adds alone. Some of that "
        "is arithmetic: where covariances simply add up and each source alone makes the variance "
        f"four times as large, the logarithm alone gives {additive_interaction(3.0):+.2f} nats "
        "of interaction to a KL divergence in 6 dimensions."
    ]


def _pairs(_, table, study):
    return [
        f"Shapley values and f of every pair, {_which_pairs(table, study)} "
        f"{_which_instances(table)}, with 95 % intervals; open dots cannot be distinguished from "
        "zero. Coloured lines are medians of a sequence, before any outlier is removed. The axes "
        "are linear up to 1 and logarithmic beyond."
    ]


OPENINGS = {
    "summary": _summary,
    "waterfall": _waterfall,
    "dependence": _dependence,
    "interactions": _interactions,
    "pairs": _pairs,
}


def dependence_sources(figure):
    """The two sources of a dependence figure, by its name: whose phi, and whose colour."""
    by_name = {
        f"dependence_{a.name}_by_{b.name}": (a, b)
        for x, y in combinations(SOURCES, 2)
        for a, b in ((x, y), (y, x))
    }
    return by_name[figure]
