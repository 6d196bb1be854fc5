"""Several estimators side by side, in words and as tables; its figure is `figures.estimators`.

A table is what `joined` made, a study the `study.Study` of the experiments that it is made of.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from tabulate import tabulate

from icpshap.report import captions, words
from icpshap.report.study import PAIR, Study, contains_zero
from icpshap.report.tables import UNSURE, escaped

if TYPE_CHECKING:
    from icpshap.estimators.kind import Returns


BLIND = 0.01  # |f|, below which an estimator sees next to nothing of a perturbation
TEXTS = ("made_of", "told", "interval_over", "no_interval", "misfit", "warning", "reason")
LATEX = {"%": r"\%", "φ": r"$\varphi$", "σ": r"$\sigma$"}
COUNTS = ["n_runs", "n_used", "n_failed"]


class Part(NamedTuple):
    """What one estimator made: tables of shap and uncertainty, and how they came about."""

    study: Study
    shap: pd.DataFrame
    uncertainty: pd.DataFrame


def joined(parts: Iterable[Part]) -> pd.DataFrame:
    """A row for each estimator and instance, in the order of the `Part`s."""
    return pd.concat([_rows(part) for part in parts], ignore_index=True)


def _rows(part):
    shap, study = part.shap, part.study
    causes = list(study.causes)
    values = ["f", *(f"phi_{name}" for name in causes)]
    numbers = [f"{name}{end}" for name in values for end in ("", "_low", "_high")]
    remarks = ["interval_over", "no_interval", "misfit", "warning", "reason"]
    settings = part.uncertainty[~part.uncertainty.again]
    success = settings.groupby([*PAIR, *causes], as_index=False).success_rate.mean()
    if not study.returns.samples:
        # An estimate that starts at the truth, or registers nothing, has nothing to succeed at.
        success["success_rate"] = np.nan
    rows = shap[[*PAIR, "instance", *causes, *numbers, *COUNTS]].merge(success, "left")
    rows[remarks] = shap[remarks].to_numpy()
    about = {
        "experiment": study.name,
        "estimator": study.estimator,
        "kind": study.kind,
        "made_of": study.estimator_kind.made_of,
        "told": told(study.options, study.returns),
        "bias_correction": study.bias_correction,
        "wrong_basins": study.wrong_basins,
    }
    return pd.concat([pd.DataFrame(about, index=rows.index), rows], axis=1)


def told(options: Mapping[str, Any], returns: Returns) -> str:
    """The noise of the sensor that an estimator is told; "" if none.

    options: of its kind; returns: kind.Returns.
    """
    if not options.get("sensor_sigma"):
        return ""
    sigma = f"{words.centimetres(options['sensor_sigma'])} cm"
    said = {
        "known": f"{sigma} and σ",
        "fixed": f"{sigma} always",
        "residuals": "its residuals",
        "draws": f"{sigma}, drawn",
        "closed_form": f"{sigma} and σ" if returns.together else sigma,
    }
    return said.get(options.get("noise", options.get("sensor_noise_by")), sigma)


def read(path: str | Path) -> pd.DataFrame:
    """The table from the file that `DataFrame.to_csv` wrote."""
    kinds = dict.fromkeys(TEXTS, str)
    table = pd.read_csv(path, dtype=kinds, keep_default_na=False, na_values=[""])
    return table.fillna(dict.fromkeys(TEXTS, ""))


def estimators(table: pd.DataFrame) -> list[str]:
    """Names of the estimators, in their order."""
    return list(table.estimator.unique())


# --- the table ------------------------------------------------------------------------------------


def markdown(table: pd.DataFrame, study: Study) -> str:
    """The table with its note as Markdown."""
    return f"{_layout(table, study, 'pipe')}\n\n{note(table, study)}\n"


def html(table: pd.DataFrame, study: Study) -> str:
    """The table as HTML."""
    return _layout(table, study, "html")


def latex(table: pd.DataFrame, study: Study) -> str:
    """The table as a tabular environment, with its note as a comment."""
    text = _layout(table, study, "latex_raw")
    for letter, command in LATEX.items():
        text = text.replace(letter, command)
    return f"% {note(table, study)}\n{text}\n"


def note(table: pd.DataFrame, study: Study) -> str:
    """What the table shows."""
    sentences = [
        f"f = {captions.reading(study)}, and how it is shared out, {_where(table, study)}.",
        "° cannot be distinguished from zero.",
        "Failed: of the registrations, or noise draws, of a setting those that failed in any "
        "setting of the instance. Success: the share that ends within 0.1 m and 2 degrees of the "
        "true pose, with all causes on.",
    ]
    if _has_several(table):
        sentences.insert(1, "Numbers are medians.")
    return " ".join([*_broken(table), *sentences])


def _layout(table, study, form):
    shown = study.shown(table)
    names = ["f", *study.phi(table)]
    header = ["Estimator", "Kind", "Covariance", "Told"]
    header += [f"{name} [{study.unit}]" for name in ("f", *(f"φ {cause.title}" for cause in shown))]
    header += ["Failed", "Success", *["95 % intervals"] * (not _has_several(table))]
    body = []
    for name in estimators(table):
        rows = table[table.estimator == name]
        first = rows.iloc[0]
        about = [name, first.kind, first.made_of, first.told]
        line = [escaped(text, form) for text in about]
        line += [_cell(rows, of, study, form) for of in names]
        line += [f"{rows.n_failed.max()} of {rows.n_runs.max()}", _share(rows.success_rate)]
        body.append(line + [_over(study.valued(rows))] * (len(rows) == 1))
    return tabulate(body, header, tablefmt=form, disable_numparse=True)


def _cell(rows, name, study, form):
    """A number with its interval, of several rows the median; marked where 0 lies in it."""
    kept = study.valued(rows)
    if len(kept) == 0:
        return "no value"
    if len(rows) > 1:
        return words.number(kept[name].median())
    value, low, high = (kept[f"{name}{end}"].item() for end in ("", "_low", "_high"))
    unsure = UNSURE[form] * bool(contains_zero(kept, name).item())
    return f"{words.with_interval(value, low, high)}{unsure}"


def _share(values):
    return "" if values.isna().all() else f"{100 * values.median():.0f} %"


def _over(kept):
    """What intervals are over, or why there are none."""
    if len(kept) == 0:
        return ""
    over = kept.interval_over.iloc[0]
    return f"over {over}" if over else f"none: {kept.no_interval.iloc[0]}"


def _has_several(table):
    return bool(table.estimator.duplicated().any())


def _where(table, study):
    return f"{captions.which_pairs(table, study)} {captions.which_instances(table, study)}"


# --- words ----------------------------------------------------------------------------------------


def caption(table: pd.DataFrame, study: Study) -> str:
    """The caption of the figure, as one paragraph."""
    sentences = [
        f"Shapley values of the causes and f, a row for each estimator, {_where(table, study)}; "
        f"f = {captions.reading(study)}."
    ]
    if _has_several(table):
        sentences.append("Dots are instances, and bars their medians.")
    else:
        sentences += _intervals(study.valued(table))
    sentences.append("The axes are linear up to 0.1 and logarithmic beyond.")
    sentences.append(f"What covariances are made of: {_grouped(table, 'made_of')}.")
    informed = table[table.told != ""]
    if len(informed):
        rest = "; the others none" * (len(informed) < len(table))
        sentences.append(
            f"Noise of the sensor that they were told: {_grouped(informed, 'told')}{rest}."
        )
    return " ".join([*_broken(table), *sentences, *_treatment(table), *_lost(table, study)])


def _intervals(kept):
    found = []
    judged = kept[kept.interval_over != ""]
    if len(judged):
        found.append(
            f"95 % intervals are taken over {_grouped(judged, 'interval_over')}; open dots cannot "
            "be told from zero."
        )
        if (judged.interval_over == "runs").any():
            found.append(
                "Those over runs are conditional on one draw of the noise and the overlap."
            )
    without = kept[kept.interval_over == ""]
    if len(without):
        found.append(f"Diamonds have no interval: {_grouped(without, 'no_interval')}.")
    return found


def _treatment(table):
    """What was done to some numbers and not to others."""
    corrected = table[table.bias_correction != "none"]
    left_out = table[table.wrong_basins == "leave_out"]
    found = []
    if len(corrected):
        found.append(f"f was corrected for its bias by {_grouped(corrected, 'bias_correction')}.")
    if len(left_out):
        found.append(
            f"Runs in a wrong basin were left out by {words.listed(estimators(left_out))}."
        )
    return found


def _lost(table, study):
    """Which rows have no value, and why."""
    lost = table.drop(study.valued(table).index)
    lost = lost.assign(why=np.where(lost.reason != "", lost.reason, lost.warning))
    return [f"No value: {_grouped(lost, 'why')}."] if len(lost) else []


def _grouped(table, column):
    """The values of a column, each with the estimators that have it, as in 'runs (a and b)'."""
    groups = table.groupby(column, sort=False)
    return "; ".join(f"{value} ({words.listed(estimators(rows))})" for value, rows in groups)


def finding(table: pd.DataFrame, study: Study, errors: Sequence[tuple[str, str, bool]] = ()) -> str:
    """The main finding in one sentence; errors: see `_pose_errors`."""
    name = f"{study.name} ({captions.which_pairs(table, study)})"
    broken = _broken(table)
    name = f"{name}: {broken[0]} As they are" if broken else name
    where = ": ".join(filter(None, [name, _pose_errors(errors)]))
    kept = study.valued(table)
    medians = kept.groupby("estimator", sort=False)[["f", *study.phi(table)]].median()
    if len(medians) == 0:
        return f"{where}: no estimator has a value."
    seeing = medians[medians.f.abs() >= BLIND]
    parts = []
    if len(seeing):
        largest = seeing[study.phi(table)].idxmax(axis=1)
        ranked = largest.value_counts(sort=True)
        titles = {f"phi_{cause.name}": cause.title for cause in study.players}
        counts = [f"{titles[name]} in {number}" for name, number in ranked.items()]
        low, high = seeing.f.idxmin(), seeing.f.idxmax()
        parts.append(
            f"the largest φ is that of {words.listed(counts)} of {len(seeing)} estimators, with f "
            f"from {words.number(seeing.f[low])} ({low}) to {words.number(seeing.f[high])} "
            f"{study.unit} ({high})"
        )
    blind = medians.index.difference(seeing.index, sort=False)
    if len(blind):
        parts.append(f"f is below {BLIND:g} {study.unit} for {words.listed(list(blind))}")
    return f"{where}: {'; '.join(parts)}."


def _broken(table):
    """What breaks the answers of which estimators, a sentence; nothing if nothing does."""
    wrong = table[table.misfit != ""]
    if wrong.empty:
        return []
    which = _grouped(wrong, "misfit")
    return [f"Settings do not fit the scans, which breaks these answers. {which}."]


def _pose_errors(errors):
    """The pose errors clean and with all causes on, of covariances last; "" if none is known.

    errors: of each estimator its name, both in words, and whether that is an error.
    """
    said = []
    for what, is_error in (("pose error (root mean square)", True), ("standard deviation", False)):
        known = [f"{text} ({name})" for name, text, error in errors if text and error == is_error]
        if known:
            of = " of covariances, where no samples tell the error," * (not is_error)
            said.append(f"{what}{of} clean to all causes {'; '.join(known)}")
    return "; ".join(said)
