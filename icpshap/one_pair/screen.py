"""An explanation as a screen of text: what a person reads first, in at most 40 lines."""

from __future__ import annotations

import textwrap
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from icpshap.report import captions, directions, effects, words

if TYPE_CHECKING:
    from icpshap.one_pair.explanation import Explanation


MOST_LINES = 40
NARROWEST = 72  # characters, of the six columns of the covariance
BAR = 24  # characters of the longest
BLOCKS = " ▏▎▍▌▋▊▉█"  # of an eighth of a character each
BOLD, RESET = "\033[1m", "\033[0m"
WARNING = "\033[33m"


def text(explanation: Explanation, width: int = 100, colours: bool = False) -> str:
    """The screen; width: of a line, in characters; colours: whether a terminal shows them.

    A width below NARROWEST is taken as that: the covariance has no shorter lines.
    """
    width = max(width, NARROWEST)
    paint = _painted if colours else lambda _, words_: words_
    head = _wrapped(explanation.sentence, width)
    body = [
        *_arrivals(explanation, width),
        "",
        *_covariance(explanation, width),
        "",
        *_causes(explanation, paint),
    ]
    end = _listed("What to do", explanation.advice, width, paint, BOLD)
    doubts = _listed("Warnings", _doubts(explanation), width, paint, WARNING)
    room = MOST_LINES - len(head) - len(body) - 2
    lines = [*(paint(BOLD, line) for line in head), "", *body]
    lines += _fitting([end, doubts], room)
    return "\n".join(lines)


def html(explanation: Explanation) -> str:
    """A short form for notebooks."""
    tables, study = explanation.tables, explanation.study
    causes = effects.table_of_causes(tables["shap"], study)
    errors = directions.html(tables["directions"], study)
    doubts = "".join(f"<li>{escape(line)}</li>" for line in _doubts(explanation))
    advice = "".join(f"<li>{escape(line)}</li>" for line in explanation.advice)
    return (
        f"<p><strong>{escape(explanation.sentence)}</strong></p>{causes}{errors}"
        f"<p>What to do</p><ul>{advice}</ul>"
        + f"<p>Warnings</p><ul>{doubts}</ul>" * bool(doubts)
        + f"<p><small>{escape(' '.join(captions.symbols(study)))}</small></p>"
    )


def _doubts(explanation):
    """The warnings that the sentence does not begin with."""
    return [text for text in explanation.warnings if text not in explanation.sentence]


def _arrivals(explanation, width):
    """How many runs arrive, and which cause has others in a wrong basin."""
    row = explanation.tables["shap"].iloc[0]
    if np.isnan(row.success_rate):
        return ["No pose samples, and so no success."]
    text = (
        f"Runs within 0.1 m and 2 degrees of the true pose: {row.clean_success_rate:.0%} clean, "
        f"{row.success_rate:.0%} with all causes on"
    )
    if row.wrong_basin_share > 0:
        text += f"; failed or in a wrong basin: {row.wrong_basin_share:.0%}"
        parts = explanation.wrong_basin
        parts = parts[parts.low > 0]
        for cause in explanation.study.players:
            if cause.name in parts.index:
                text += f", by {cause.title} {parts.value[cause.name]:.0%}"
    return _wrapped(f"{text}.", width)


def _covariance(explanation, width):
    """The covariance, its standard deviations and the weakest direction."""
    found = explanation.covariance
    lines = _wrapped(f"{found.in_words()}, all causes on:", width)
    if np.isnan(found.matrix).any():
        return [*lines, "  no value: too few runs are left"]
    lines += ["  " + "".join(f"{entry:11.2e}" for entry in row) for row in found.matrix]
    deviations = found.standard_deviations
    turns = " ".join(words.significant(np.rad2deg(part)) for part in deviations[:3])
    moves = " ".join(words.significant(100 * part) for part in deviations[3:])
    lines.append(f"Standard deviations: rotation {turns} deg, translation {moves} cm")
    weakest = explanation.weakest_direction
    told = (
        f"Weakest direction: {weakest.words}, {words.significant(weakest.clean)} cm clean, "
        f"{words.significant(weakest.perturbed)} cm with all causes on"
    )
    return lines + _wrapped(told, width, "  ")


def _causes(explanation, paint):
    """A bar a cause."""
    study, table = explanation.study, explanation.shapley
    shown = study.shown(explanation.tables["shap"])
    values = table.value.abs()
    largest = values.max() if values.notna().any() and values.max() > 0 else 1.0
    f = explanation.tables["shap"].iloc[0]
    told = words.with_interval(f.f, f.f_low, f.f_high)
    title = f"Shapley values φ, the share of each cause in f = {told} {study.unit}"
    lines = [paint(BOLD, title)]
    longest = max((len(_cause(cause, explanation)) for cause in shown), default=0)
    for cause in shown:
        row = table.loc[cause.name]
        size = 0.0 if np.isnan(row.value) else abs(row.value) / largest
        told = words.with_interval(row.value, row.low, row.high)
        bar = _bar(size) if row.value >= 0 else _bar(size).replace("█", "▒")
        lines.append(f"  {_cause(cause, explanation):<{longest}}  {bar:<{BAR}}  {told}")
    return lines


def _cause(cause, explanation):
    return f"{cause.title} {words.level(cause, explanation.levels[cause.name])}"


def _bar(share):
    """A bar of a share of the longest."""
    eighths = round(share * BAR * 8)
    full, rest = divmod(eighths, 8)
    return "█" * full + BLOCKS[rest].strip()


def _listed(title, texts, width, paint, colour):
    """(title, [lines of each text])."""
    return paint(colour, title), [_wrapped(f"- {line}", width, "  ") for line in texts]


def _fitting(blocks, room):
    """Lines of titled blocks that fit into so many; what does not is counted."""
    lines: list[str] = []
    for number, (title, texts) in enumerate(blocks):
        if not texts:
            continue
        # Of each block that follows a title and a line are kept free.
        kept = 3 * sum(bool(others) for _, others in blocks[number + 1 :])
        free = room - len(lines) - kept - 3
        shown: list[str] = []
        for of_text in texts:
            if shown and len(shown) + len(of_text) > free:
                break
            shown += _cut(of_text, max(free, 1))
        left = len(texts) - sum(line.startswith("- ") for line in shown)
        lines += ["", title, *shown] + [f"- and {left} more"] * bool(left)
    return lines


def _cut(lines, room):
    """The first lines of a text, so many, with dots where more of it is left out."""
    if len(lines) <= room:
        return lines
    *before, last = lines[:room]
    return [*before, f"{last[:-3].rpartition(' ')[0]} ..."]


def _wrapped(line, width, indent=""):
    return textwrap.wrap(line, width, subsequent_indent=indent, break_long_words=False)


def _painted(colour, line):
    return f"{colour}{line}{RESET}"
