"""Which cause matters most in a sequence: medians, their order, the paper's values.

A two-level bootstrap says how sure they are. Pairs are drawn again in blocks of two neighbours,
which share a scan, and for each a resample of its runs, in which its Shapley values stay together.
That counts the runs' part of the spread twice, since the pairs' values differ by it already: the
intervals err on the wide side.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from icpshap.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


CONFIDENCE = 0.95
DRAWS = 2000
DRAWS_AT_ONCE = 100
BLOCK = 2
FEW_PAIRS = 5
ENDS = ("low", "high")
OUTLIER_RULES = ("none", "iqr", "positive_then_iqr")


def ranking_table(
    shap: pd.DataFrame,
    resampled: pd.DataFrame,
    causes: Sequence[str],
    paper: pd.DataFrame = None,
    order: Sequence[str] = (),
    seed: int = 0,
) -> pd.DataFrame:
    """A row per sequence and outlier rule: medians of phi, and whether they follow the order.

    shap, resampled: tables of `games` for the same pairs and instances; causes: names; paper: table
    with `sequence` and a column per cause; order: names, of which those of the causes count.
    `probability` is the share of the bootstrap in which each cause of the order exceeds the next,
    `p` the largest of the one-sided p values of these steps, `p_holm` that after Holm's correction
    for the number of sequences; with fewer than two causes in order all are NaN, and so is `order`.
    From fewer than five pairs there are medians, but no statistics of how pairs differ: no outlier
    rule is applied and no order judged; `warning` says so.
    """
    order = [name for name in order if name in causes]
    rows = []
    for sequence, table in shap.groupby("sequence", sort=False):
        own = resampled[resampled["sequence"] == sequence]
        values = _by_pair(table, causes, ["instance"])
        draws = _by_pair(own, causes, ["instance", "resample"])
        if len(draws) != len(values):
            raise UserError(
                f"{sequence}: {len(values)} pairs have Shapley values, {len(draws)} have resamples."
                "\nHint: make both tables from the same runs."
            )
        n_pairs = len(values)
        if n_pairs == 0:
            values, draws = (np.full((*[1] * k, len(causes)), np.nan) for k in (2, 3))
        for rule in OUTLIER_RULES if n_pairs >= FEW_PAIRS else OUTLIER_RULES[:1]:
            generator = np.random.default_rng(seed)
            medians = bootstrap_medians(np.moveaxis(draws, 2, 0), rule, generator)
            row = {"sequence": sequence, "outlier_rule": rule, "n_pairs": n_pairs}
            row |= _medians(values.reshape(-1, len(causes)), rule, medians, causes)
            if n_pairs == 1 and values.size == len(causes) and row["n_removed"] == 0:
                row |= _own_intervals(table, causes)
            row |= _agreement(row, sequence, paper, causes)
            row |= _order(medians, causes, order if n_pairs >= FEW_PAIRS else ())
            rows.append(row | {"warning": _few_pairs(n_pairs)})
    table = pd.DataFrame(rows)
    for _, part in table.groupby("outlier_rule"):
        table.loc[part.index, "p_holm"] = holm(part["p"].to_numpy())
    return table


def kept_rows(values: np.ndarray, rule: str) -> np.ndarray:
    """Rows of phi (..., n, M) that an outlier rule keeps, bool (..., n); NaN rows never.

    iqr: a row goes if any of its columns lies further than 1.5 interquartile ranges (linear
    quantiles) outside the quartiles; positive_then_iqr: the same after rows with a negative value.
    """
    kept = ~np.isnan(values).any(axis=-1)
    if rule == "none":
        return kept
    if rule == "positive_then_iqr":
        kept &= (values >= 0).all(axis=-1)
    lower, upper = quantiles(values, kept, [0.25, 0.75])
    reach = 1.5 * (upper - lower)
    inside = (values >= (lower - reach)[..., None, :]) & (values <= (upper + reach)[..., None, :])
    return kept & inside.all(axis=-1)


def quantiles(
    values: np.ndarray, kept: np.ndarray, probabilities: Iterable[float | np.ndarray]
) -> np.ndarray:
    """Linear quantiles over the kept rows (..., n) of values (..., n, M): (p, ..., M)."""
    ordered = np.sort(np.where(kept[..., None], values, np.nan), axis=-2)
    count = kept.sum(axis=-1)[..., None, None]
    result = []
    for probability in probabilities:
        position = np.nan_to_num(np.maximum(probability * (count - 1), 0))
        low = np.floor(position).astype(int)
        high = np.minimum(low + 1, np.maximum(count - 1, 0))
        ends = [
            np.take_along_axis(ordered, np.broadcast_to(end, (*ordered.shape[:-2], 1, 1)), axis=-2)
            for end in (low, high)
        ]
        result.append((ends[0] + (position - low) * (ends[1] - ends[0]))[..., 0, :])
    return np.array(result)


def bootstrap_medians(draws: np.ndarray, rule: str, generator: np.random.Generator) -> np.ndarray:
    """Bootstrap medians (DRAWS, M) of a sequence, from resamples of its pairs (r, pairs, i, M)."""
    number, pairs, _, players = draws.shape
    blocks = -(-pairs // BLOCK)
    result = []
    for _ in range(DRAWS // DRAWS_AT_ONCE):
        starts = generator.integers(pairs, size=(DRAWS_AT_ONCE, blocks, 1))
        chosen = (starts + np.arange(BLOCK)).reshape(DRAWS_AT_ONCE, -1)[:, :pairs] % pairs
        phi = draws[generator.integers(number, size=chosen.shape), chosen]
        phi = phi.reshape(DRAWS_AT_ONCE, -1, players)
        result.append(quantiles(phi, kept_rows(phi, rule), [0.5])[0])
    return np.concatenate(result)


def holm(p: ArrayLike) -> np.ndarray:
    """Holm's step-down correction of p values (n,); NaN stays NaN and does not count.

    >>> holm(np.array([0.01, 0.04, np.nan])).tolist()
    [0.02, 0.04, nan]
    """
    p = np.asarray(p, dtype=float)
    ranked = np.argsort(p)[: np.count_nonzero(~np.isnan(p))]
    steps = p[ranked] * np.arange(len(ranked), 0, -1)
    corrected = np.full(p.shape, np.nan)
    corrected[ranked] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected


def _by_pair(table, causes, keys):
    """Values phi (pairs, *keys, M) of the pairs that have any, in the order of the pairs."""
    table = table.sort_values(["reference", "source", *keys])
    shape = [table[key].nunique() for key in keys]
    values = table[[f"phi_{name}" for name in causes]].to_numpy()
    values = values.reshape(-1, *shape, len(causes)) if len(values) else values
    return values[~np.isnan(values).all(axis=tuple(range(1, values.ndim)))]


def _medians(values, rule, medians, causes):
    kept = kept_rows(values, rule)
    median = quantiles(values, kept, [0.5])[0]
    tails = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
    low, high = quantiles(medians, ~np.isnan(medians).any(axis=-1), tails)
    n_rows = int(kept_rows(values, "none").sum())
    row = {"n_rows": n_rows, "n_removed": n_rows - int(kept.sum())}
    for a, name in enumerate(causes):
        row |= {
            f"median_{name}": median[a],
            f"median_{name}_low": low[a],
            f"median_{name}_high": high[a],
        }
    return row


def _own_intervals(table, causes):
    """The intervals of the one row that has values: its phi has no second one as a median."""
    (row,) = table.dropna(subset=[f"phi_{name}" for name in causes]).to_dict(orient="records")
    return {f"median_{name}_{end}": row[f"phi_{name}_{end}"] for name in causes for end in ENDS}


def _agreement(row, sequence, paper, causes):
    """The paper's values, and whether they lie in our intervals."""
    found: dict[str, Any] = {}
    for name in causes:
        value = np.nan
        if paper is not None and name in paper:
            match = paper.loc[paper["sequence"] == sequence, name]
            value = match.iloc[0] if len(match) else np.nan
        inside = row[f"median_{name}_low"] <= value <= row[f"median_{name}_high"]
        found |= {f"paper_{name}": value, f"paper_{name}_inside": bool(inside)}
    return found


def _order(medians, causes, order):
    if len(order) < 2:
        return dict.fromkeys(("order", "probability", "p"), np.nan)
    columns = [list(causes).index(name) for name in order]
    steps = medians[:, columns[:-1]] - medians[:, columns[1:]]
    steps = steps[~np.isnan(steps).any(axis=1)]
    found = {"order": " > ".join(order), "probability": np.nan, "p": np.nan}
    if len(steps):
        found["probability"] = (steps > 0).all(axis=1).mean()
        found["p"] = ((1 + (steps <= 0).sum(axis=0)) / (1 + len(steps))).max()
    return found


def _few_pairs(number):
    if number >= FEW_PAIRS:
        return ""
    pairs = "1 pair" if number == 1 else f"{number} pairs"
    return (
        f"{pairs} with values, fewer than {FEW_PAIRS}: too few to see how pairs differ, so no "
        "outlier is removed and no order of the causes is judged"
    )
