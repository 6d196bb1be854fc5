"""The tables of an explanation of a sequence, made from the files of its jobs."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import pandas as pd

from icpshap import plan, tables
from icpshap.estimators.kind import Returns
from icpshap.explanation import games
from icpshap.explanation.method import Method
from icpshap.fit import checks
from icpshap.jobs import plans, played
from icpshap.jobs.progress import in_turn
from icpshap.tables import PAIR


def explained(
    paths: Any,
    planned: Mapping[str, Any],
    jobs: Sequence[str],
    checked: Sequence[str],
    only: Collection[tuple[int, int]] | None = None,
) -> dict[str, pd.DataFrame]:
    """Frames by name of the table, of all pairs of a sequence or of those of `only`.

    paths: lists of files `pairs` and `fit` of the jobs that check, `runs` and `estimates` of those
    that estimate, and `instances`, with nothing or one; planned: the plan of the explanation; jobs,
    checked: digests of the plans of the jobs; only: pairs (reference, source) of which all jobs are
    among the files, None for all. A pair's rows do not depend on which others are explained, but
    for those of the fit table where others are run on it. Raises TableError for a file that another
    plan made.
    """
    causes = list(planned["off"])
    method = Method(**planned["method"], seed=planned["seed"])
    for files in (paths.pairs, paths.fit):
        for path, expected in zip(files, checked, strict=True):
            plans.check(path, expected)
    pairs = tables.read_all(paths.pairs, "pairs")
    found = played.games(pairs, planned, paths.instances)
    for files in filter(None, (paths.runs, paths.estimates)):
        plans.check_estimates(files, jobs, planned, paths.pairs)
    runs, estimates = (tables.ByPair(getattr(paths, of), of) for of in ("runs", "estimates"))
    pairs = played.described(pairs, found)
    rows = played.by_pair(pairs)
    made = {"pairs": [pairs], **{name: [] for name in games.Explanation._fields}}
    made["resampled"] = [tables.empty("resampled", causes, planned)]

    def explain(indices):
        game = found[indices]
        instances = pd.DataFrame(plan.instances(game.levels), columns=causes)
        instances = instances.rename_axis("instance").reset_index()
        returned = (runs.get(indices), estimates.get(indices))
        read_by = (planned["off"], Returns(**planned["returns"]), method)
        arguments = (*returned, instances, *read_by, played.scan_pair(game, rows, planned))
        of_pair = games.explain(*arguments, game.reason)._asdict()
        if not game.reason:
            of_pair["resampled"] = games.resampled_values(*arguments)
        return of_pair

    chosen = [indices for indices in found if only is None or indices in only]
    for of_pair in in_turn(chosen, explain, "pairs"):
        for table, frame in of_pair.items():
            made[table].append(frame)
    joined = {table: pd.concat(frames, ignore_index=True) for table, frames in made.items()}
    numbers = tables.read_all(paths.fit, "fit_numbers")
    run = played.as_run(joined["uncertainty"], planned)
    joined["fit"] = checks.complete(numbers, run, planned["off"])
    broken = checks.marked(played.as_run(joined["shap"], planned), joined["fit"]).misfit
    joined["shap"] = joined["shap"].assign(misfit=broken)
    if only is not None:
        for table in ("pairs", "fit"):
            joined[table] = _of(joined[table], only)
    return joined


def _of(table, pairs):
    """The rows of a table that are of these pairs (reference, source)."""
    indices = zip(*(table[name] for name in PAIR[1:]), strict=True)
    return table[[pair in pairs for pair in indices]].reset_index(drop=True)
