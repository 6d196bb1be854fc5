"""Does what an explanation says would help, help on draws that it has not seen?

    python -m benchmarks.mitigation [--every 4]

Pairs of simulated scans (six scenes, two scanners) and, where ICPSHAP_REAL_DATA is set, the two
real pairs, are explained by two presets, three causes on at levels drawn for each, with what-if.
What is said is then measured on fresh draws: another seed, twice the runs and noise draws.

The rules were written down before the first run:

Removal. The cause with the largest removal effect is right if its removal lowers f (or V, the mean
logarithm of the error) most on the fresh draws. Where the joint jackknife interval of the
difference between the two best fresh drops contains 0, either is as good: such a case is counted
apart, and right there if the named cause cannot be told from the best. Regret is (best drop - drop
of the named) / best drop, where the best is positive; it may exceed 1.

Advice. What-if names a change and promises that the error with all causes on falls: right if the
error on the fresh draws is smaller with the change than as it is. How much of the promised fall (of
its logarithm) is measured stands beside it. Where nothing helps by a tenth, that is right unless a
change that was tried lowers the fresh error by a tenth with the whole of its interval. The interval
of f with the change holds if the fresh f lies in it, widened in squares by the fresh one's own.
What is advised untried is not counted.

Printed are the cases that go wrong, tables with Wilson intervals, and JSON as the last line.
"""

import argparse
import json
from collections import defaultdict
from typing import NamedTuple

import numpy as np
from tabulate import tabulate

import icpshap
from benchmarks import real_pairs
from benchmarks.attribution import injector
from benchmarks.attribution.score import Score
from icpshap.causes import CAUSES
from icpshap.data.pair import Pair
from icpshap.errors import DataError
from icpshap.explanation.intervals import Resampling
from icpshap.explanation.sample import samples
from icpshap.explanation.uncertainty import estimate
from icpshap.one_pair.given import given
from icpshap.plan import Setting
from icpshap.report import what_if

SEED, FRESH_SEED = 20261130, 41
REAL = "real"
# An explanation of each sequence, of two scans of its own, and of each real pair.
CHAINS = ({"based_on": "lidar", "overlap_shape": "sector"}, {"based_on": "paper"})
# Levels at which no cause is always the largest, log-uniform; of shares, that of what remains.
RANGES = {
    "sensor_noise": (0.004, 0.03),  # m
    "initial_pose": (4.0, 16.0),
    "partial_overlap": (0.25, 0.7),  # of what overlaps
    "under_constrained": (0.03, 0.3),  # of the information
    "icp_randomness": (2.0, 4.0),
}
CAUSES_ON = 3
# Which removal is named by what, and measured in what.
READINGS = {"f": ("f", "f"), "V, named by f": ("f", "V"), "V": ("V", "V")}


class Case(NamedTuple):
    """A pair, the levels by cause at which it is explained, and the estimator's options."""

    where: tuple
    pair: Pair
    levels: dict
    estimator: dict

    @property
    def name(self):
        return f"{' '.join(self.where)} {self.estimator['based_on']}"

    def explained(self):
        """The `Explanation`."""
        of = self.pair
        return icpshap.explain(
            of.reference,
            of.source,
            of.T_reference_source,
            causes=self.levels,
            estimator=self.estimator,
            what_if=True,
            seed=SEED,
            threads=1,
        )


class Drops(NamedTuple):
    """What f or V falls by without each cause (M,); how much more it does without one than another.

    apart (3, M, M): row less column, with the ends of its interval.
    """

    value: np.ndarray
    apart: np.ndarray

    @property
    def first(self):
        return int(np.argmax(self.value))

    @property
    def clear(self):
        """Whether the best can be told from the next."""
        second = np.argsort(self.value)[-2]
        return bool(self.apart[1, self.first, second] > 0)

    def as_good(self, cause):
        """Whether a cause cannot be told from the best."""
        return cause == self.first or not self.apart[1, self.first, cause] > 0

    def regret(self, cause):
        """Share of the best drop that a cause's lacks; NaN where none is positive."""
        best = self.value[self.first]
        return (best - self.value[cause]) / best if best > 0 else np.nan


class Error(NamedTuple):
    """Of one setting: squared errors (n,) [m^2] at the length L, NaN of failed runs; their draws.

    f (3,): against the clean setting, and the ends of its interval.
    """

    square: np.ndarray
    noise_draw: np.ndarray
    f: np.ndarray


class Counts:
    """What is counted over all cases."""

    def __init__(self):
        self.clear = {name: Score() for name in READINGS}
        self.unclear = {name: Score() for name in READINGS}
        self.regret = {name: defaultdict(list) for name in READINGS}
        self.promised, self.nothing, self.interval = Score(), Score(), Score()
        self.kept = defaultdict(list)  # shares of the promised fall
        self.refused = self.without_value = 0

    def count_removal(self, reading, named, drops, groups):
        """Whether the removal of the cause named (its place) is the best on fresh draws."""
        right = named == drops.first if drops.clear else drops.as_good(named)
        (self.clear if drops.clear else self.unclear)[reading].count(right, *groups)
        for group in groups:
            self.regret[reading][group].append(drops.regret(named))

    def count_promise(self, promised, measured, groups):
        """Logarithms of the error with the change over that as it is."""
        self.promised.count(measured < 0, *groups)
        for group in groups:
            self.kept[group].append(measured / promised)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--every", type=int, default=1, help="only every so many cases (odd)")
    counts = Counts()
    for case in list(cases())[:: parser.parse_args().every]:
        try:
            found = case.explained()
        except DataError as error:
            counts.refused += 1
            print(f"refused, {case.name}: {error}", flush=True)
            continue
        fresh = Fresh(case)
        registered = fresh.game()
        _count_removal(case, found, *registered, counts)
        _count_advice(case, found, fresh, error_of(*registered), counts)
        print(f"done, {case.name}: {_in_words(case.levels)}", flush=True)
    _print(counts)


def cases():
    """Every pair with the levels at which it is explained."""
    place = 0
    for scene in injector.SCENES:
        for scanner in injector.SCANNERS:
            sequence = injector.sequence(scene, scanner, SEED)
            for k, chain in enumerate(CHAINS):
                clouds = sequence.clouds[2 * k : 2 * k + 2]
                pair = Pair.measured(
                    *clouds, sequence.T(2 * k), real_pairs.PERTURBATION.overlap_distance
                )
                yield _case((scene, scanner), pair, chain, place)
                place += 1
    for name in real_pairs.PATHS if real_pairs.folder() else ():
        for chain in CHAINS:
            yield _case((REAL, name), real_pairs.real_pair(name), chain, place)
            place += 1


def _case(where, pair, chain, place):
    generator = np.random.default_rng([SEED, place])
    on = set(generator.choice(list(RANGES), CAUSES_ON, replace=False))
    levels = {}
    for cause, ends in RANGES.items():
        value = float(np.exp(generator.uniform(*np.log(ends))))
        if cause in on:
            levels[cause] = 1.0 - value if "constrained" in cause else value
    if "partial_overlap" in on:
        levels["partial_overlap"] = (1.0 - levels["partial_overlap"]) * pair.overlap
    return Case(where, pair, levels, chain)


class Fresh:
    """Fresh draws of a case: another seed, twice the runs and noise draws."""

    def __init__(self, case):
        self.case = case
        asked = given(case.levels, case.estimator, None, True, None)
        self.preset, self.changes = asked.preset, asked.what_if

    def game(self):
        """(`Game`, sample) of the clean setting, of all causes but each, and of all."""
        levels = self.case.levels
        off = {name: CAUSES[name].off for name in levels}
        return self._registered(
            self.preset, levels, [off, *({**levels, name: off[name]} for name in levels), levels]
        )

    def with_change(self, name):
        """(`Game`, sample) of the clean setting and of all causes, with a change that was tried."""
        _, levels, preset = self.changes[name]
        off = {cause: CAUSES[cause].off for cause in levels}
        return self._registered(preset, levels, [off, levels])

    def _registered(self, preset, levels, settings):
        more = {"runs": 2 * preset.options["runs"]}
        if preset.options["noise_draws"] > 1:
            more["noise_draws"] = 2 * preset.options["noise_draws"]
        preset = preset.with_options(**more)
        game = real_pairs.Game(self.case.name, self.case.pair, preset, levels, FRESH_SEED)
        runs, estimates = game.estimated([Setting.at(values) for values in settings])
        return game, sample_of(game, runs, estimates)


def sample_of(game, runs, estimates=None):
    """The `Sample` of the runs of a `Game`."""
    length = game.scan_pair.characteristic_length
    given_ = (game.off, game.estimator.returned, game.preset.method, length)
    return samples(runs, estimates, *given_)[0]


def drops_of(game, sample, divergence=None):
    """The `Drops` of f, or of another reading, by the causes of a game."""
    method = game.preset.method
    if divergence is not None:
        method = game.preset.with_options(divergence=divergence).method
    levels = np.array([level for (level,) in game.levels.values()])
    off = np.array(list(game.off.values()))
    without = np.where(np.eye(len(levels), dtype=bool), off, levels)
    rows = sample.rows(np.vstack([off, without, levels]))[None]
    found = estimate(sample, rows, _differences, method)
    number = len(levels)
    apart = [
        part[0, number:].reshape(number, number) for part in (found.value, found.low, found.high)
    ]
    return Drops(found.value[0, :number], np.array(apart))


def _differences(game):
    """Drops without each cause, then of each less each other's, of games (..., 1 + M + 1)."""
    drops = game[..., -1:] - game[..., 1:-1]
    apart = drops[..., :, None] - drops[..., None, :]
    return np.concatenate([drops, apart.reshape(*drops.shape[:-1], -1)], axis=-1)


def error_of(game, sample):
    """The `Error` of the setting with all causes on."""
    levels = np.array([level for (level,) in game.levels.values()])
    clean, on = sample.rows(np.array([list(game.off.values()), levels]))
    length = game.scan_pair.characteristic_length
    square = sample.numbers("square_translation") + length**2 * sample.numbers("square_rotation")
    f = estimate(sample, np.array([[clean, on]]), lambda pair: pair[..., 1:], game.preset.method)
    ends = np.array([f.value[0, 0], f.low[0, 0], f.high[0, 0]])
    return Error(square[on], sample.noise_draw, ends)


def log_ratio(changed, now):
    """Logarithm of the root mean square error with a change over that as it is, and its interval.

    changed, now: `Error`s with the same draws. Of runs that failed in neither.
    """
    kept = np.isfinite(changed.square) & np.isfinite(now.square)
    plan = Resampling.of(kept, now.noise_draw, True, 0, 0)
    means = [
        (plan.weights[:, kept] @ part.square[kept]) / plan.weights.sum(axis=1)
        for part in (changed, now)
    ]
    values = 0.5 * np.log(means[0] / means[1])
    return values[0], *plan.interval(values)


def holds(stated, fresh):
    """Whether a fresh f lies in the stated interval, widened in squares by its own; (3,) each."""
    value, low, high = stated
    below = np.hypot(value - low, fresh[2] - fresh[0])
    above = np.hypot(high - value, fresh[0] - fresh[1])
    return bool(-below <= fresh[0] - value <= above)


def _count_removal(case, found, game, sample, counts):
    """Whether what each reading names is the best removal on the fresh draws of a game."""
    runs = sample_of(game, found.tables["runs"])
    named = {"f": found.removal.value.to_numpy(), "V": drops_of(game, runs, "log_error").value}
    measured = {"f": drops_of(game, sample), "V": drops_of(game, sample, "log_error")}
    if any(
        np.isnan(drops).any() for drops in (*named.values(), *(d.value for d in measured.values()))
    ):
        counts.without_value += 1
        print(f"without a value: {case.name}, {_in_words(case.levels)}", flush=True)
        return
    causes = list(case.levels)
    for reading, (by, of) in READINGS.items():
        first, drops = int(np.argmax(named[by])), measured[of]
        counts.count_removal(reading, first, drops, _groups(case))
        said, seen = (
            _in_words(dict(zip(causes, values, strict=True))) for values in (named[by], drops.value)
        )
        right = "best" if first == drops.first else "as good" if drops.as_good(first) else "WRONG"
        clear = "" if drops.clear else ", none is clearly the best"
        print(f"{reading}, {case.name}: {right}{clear}; said {said}; fresh {seen}", flush=True)


def _count_advice(case, found, fresh, before, counts):
    """Whether what-if's advice does what it says on fresh draws; before: their `Error` as it is."""
    table = found.tables["what_if"]
    now, best = what_if.now_and_best(table)
    groups = _groups(case)
    if best is None:
        tried = {
            name: log_ratio(error_of(*fresh.with_change(name)), before) for name in fresh.changes
        }
        helping = [name for name, (_, _, high) in tried.items() if high < np.log(what_if.HELPS)]
        counts.nothing.count(not helping, *groups)
        if helping:
            print(f"something helps, {case.name}: {', '.join(helping)}", flush=True)
        return
    after = error_of(*fresh.with_change(best.what_if))
    promised = np.log(best.error / now.error)
    measured, low, high = log_ratio(after, before)
    counts.count_promise(promised, measured, groups)
    stated = np.array([best.f, best.f_low, best.f_high])
    if not np.isnan([*stated, *after.f]).any():
        counts.interval.count(holds(stated, after.f), *groups)
    print(
        f"{'as promised' if measured < 0 else 'NOT as promised'}, {case.name}: {best.what_if}, "
        f"error times {np.exp(promised):.2f}, fresh {np.exp(measured):.2f} [{np.exp(low):.2f}, "
        f"{np.exp(high):.2f}]; f {_ends(stated)}, fresh {_ends(after.f)}",
        flush=True,
    )


def _groups(case):
    """The groups that a case is counted in; the real pairs' are apart."""
    first, second = case.where
    if first == REAL:
        return [(REAL, "all"), (REAL, second)]
    return [("simulated", word) for word in ("all", second, first, case.estimator["based_on"])]


def _in_words(values):
    return ", ".join(f"{name} {value:.3g}" for name, value in values.items())


def _ends(values):
    return "{:.2f} [{:.2f}, {:.2f}]".format(*values)


def _print(counts):
    header = ["group", "of", "cases", "share", "low", "high"]
    for reading in READINGS:
        for title, scores in (
            ("", counts.clear),
            (", cannot be told from the best", counts.unclear),
        ):
            _print_table(
                f"{reading}: the named removal is the best{title}", scores[reading], header
            )
        rows = [
            [*group, len(values), *np.round([np.nanmean(values), np.nanmax(values)], 3)]
            for group, values in counts.regret[reading].items()
            if np.isfinite(values).any()
        ]
        _print_rows(f"{reading}: regret", rows, ["group", "of", "cases", "mean", "largest"])
    _print_table("advice: the error falls as promised", counts.promised, header)
    rows = [
        [*group, len(kept), round(float(np.median(kept)), 2)] for group, kept in counts.kept.items()
    ]
    _print_rows("advice: share of the promised fall", rows, ["group", "of", "cases", "median"])
    _print_table("advice: nothing helps, and nothing does", counts.nothing, header)
    _print_table("advice: the interval of f holds", counts.interval, header)
    print(f"\nnot counted: {counts.refused} refused, {counts.without_value} without a value\n")
    print(json.dumps(_json(counts)))


def _print_table(title, score, header):
    _print_rows(title, score.rows(), header)


def _print_rows(title, rows, header):
    if rows:
        print(f"\n{title}\n\n{tabulate(rows, header, 'pipe')}")


def _json(counts):
    """The keys of the benchmark, of the simulated pairs; null of what was not run."""
    group = ("simulated", "all")
    regret = counts.regret["f"][group]
    values = {
        "removal_is_best": counts.clear["f"].share(group)[0],
        "regret": np.nanmean(regret) if np.isfinite(regret).any() else np.nan,
        "advice_right": counts.promised.share(group)[0],
    }
    return {
        name: None if np.isnan(value) else round(float(value), 4) for name, value in values.items()
    }


if __name__ == "__main__":
    main()
