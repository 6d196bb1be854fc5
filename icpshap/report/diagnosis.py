"""What is wrong with pairs of scans, in words; tables are those of `diagnosis.table`."""

import numpy as np
from tabulate import tabulate

from icpshap import causes
from icpshap.diagnosis.diagnose import NONE, OTHERS
from icpshap.diagnosis.verdict import FOUND, NOTHING, UNDECIDED
from icpshap.report import words
from icpshap.report.study import pairs_of
from icpshap.tables import PAIR


def sentence(row):
    """The verdict on a pair, a row (a named tuple) of the table, with its confidence."""
    beside = {
        OTHERS: f"Beside {row.healthy_pairs} other pair{'s' * (row.healthy_pairs > 1)}",
        NONE: "With no other pair",
    }.get(row.against, "Beside the scanner's data sheet")
    sure = f"probability {row.confidence:.2f}"
    if row.verdict == NOTHING:
        return f"{beside} nothing stands out ({sure})."
    names = row.causes.split(", ") if row.causes else []
    if row.verdict == UNDECIDED:
        both = words.listed(words.titles(names))
        return f"{beside} {both} cannot be told apart; one of them stands out ({sure})."
    if row.verdict == FOUND:
        found = [_found(name, row) for name in names]
        return f"{beside} {words.listed(found)} stand{'s' * (len(names) == 1)} out ({sure})."
    return (
        f"{beside} or scanner to be held against, nothing can be called unusual: give healthy pairs"
        " of the same scanner in the same kind of place, or name the scanner."
    )


def _found(name, row):
    cause = causes.CAUSES[name]()
    level = getattr(row, f"level_{name}")
    at = f"{cause.symbol} = {words.significant(level)} {cause.unit}".strip()
    return f"{cause.title} ({at}, {getattr(row, f'z_{name}'):+.1f} standard deviations)"


def weakest(row):
    """The direction of the pose that a pair holds least."""
    share = words.significant(100 * row.weakest_information)
    return f"Weakest direction: {row.weakest}, with {share} % of the information (16.7 % is even)."


def unseen():
    """Which causes no scan shows, and why they are not in a verdict."""
    known = causes.CAUSES.values()
    told = words.listed([cause.title for cause in known if cause.told])
    hidden = words.listed([c.title for c in known if not (c.told or c.shown_by)])
    return (
        f"Told by the configuration, not measured: {told}. Not visible in scans: {hidden}. A pair "
        "is held against others: what all of them have is not seen."
    )


def summary(table, pair_name):
    """How many pairs of a table stand out, and by what; pair_name: words of a row's pair."""
    if len(table) == 1:
        return sentence(next(table.itertuples()))
    named = table[table.verdict.isin([FOUND, UNDECIDED])]
    if named.empty:
        compared = (table.against == OTHERS).any()
        return (
            f"Nothing stands out in any of {len(table)} pairs, each beside the others."
            if compared
            else sentence(next(table.itertuples()))
        )
    parts = [f"{pair_name(row)}: {_short(row)}" for row in named.itertuples()]
    return f"Of {len(table)} pairs {len(named)} stand out beside the others: {'; '.join(parts)}."


def _short(row):
    names = row.causes.split(", ")
    if row.verdict == UNDECIDED:
        return " or ".join(words.titles(names))
    return words.listed([_found(name, row) for name in names])


def html(table, shap, study):
    """What was found of each pair, as an HTML table; cells: standard deviations from the others.

    shap: the shap table of the same pairs, which knows where clean runs end.
    """
    names = causes.shown()
    lost = pairs_of(shap).set_index(PAIR).clean_wrong_basin_share
    rows = [
        [
            study.pair(row),
            *(_standing(getattr(row, f"z_{name}")) for name in names),
            _short(row) if row.verdict in (FOUND, UNDECIDED) else row.verdict,
            "" if np.isnan(row.confidence) else f"{row.confidence:.2f}",
            _share(lost.get((row.sequence, row.reference, row.source), np.nan)),
        ]
        for row in table.itertuples()
    ]
    deviations = [f"{title}, deviations" for title in words.titles(names)]
    header = ["pair", *deviations, "verdict", "probability", "clean runs in a wrong basin"]
    return tabulate(rows, header, tablefmt="html", disable_numparse=True)


def _share(value):
    return "" if np.isnan(value) else f"{value:.0%}"


def _standing(z):
    return "" if np.isnan(z) else f"{z:+.1f}"
