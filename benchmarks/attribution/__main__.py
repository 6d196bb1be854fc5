"""Does an explanation name what was done to a pair? Degraded pairs of scans, and who finds it out.

    python -m benchmarks.attribution [--seed 20261130] [--scenes corridor street] [--every 9]
        [--groups single unknown mixture clean real]
        [--explainers diagnosis removal ceiling forward]

Pairs of simulated scans are degraded (`injector`); what each part does to ICP is measured
(`effects`): the labels that an explainer (`explainers`) must find. Cases without an effect are
counted apart; single causes that a robot is told of are none. Printed are the cases that the
diagnosis gets wrong, tables with Wilson intervals, and JSON as the last line.
"""

import argparse
import json
from collections import defaultdict

import numpy as np
from tabulate import tabulate

from benchmarks.attribution import explainers, injector
from benchmarks.attribution.effects import effects
from benchmarks.attribution.real import real_cases
from benchmarks.attribution.score import MARGIN, Score, share_of_best_drop

GROUPS = {
    "single": injector.single_cases,
    "unknown": injector.unknown_cases,
    "mixture": injector.mixtures,
}
CLEAN = "clean"  # pairs to which nothing was done
REAL = "real"  # where ICPSHAP_REAL_DATA is set
EXPLAINERS = ("diagnosis", "removal", "ceiling", "forward")
FORWARD_EVERY = 7  # cases of a group: its 32 settings cost twice what all others do together


class Counts:
    """What is counted over all cases."""

    def __init__(self):
        self.scores = {name: Score() for name in EXPLAINERS}
        self.drops = defaultdict(list)  # shares of the best one, of mixtures
        self.levels = defaultdict(list)  # (true, diagnosed) by mechanism
        self.told = 0
        self.false_alarms = Score()
        self.without_effect = Score()


def main():
    given = _arguments()
    # All of them, since numbers of cases are those of the whole benchmark.
    sequences = [
        injector.sequence(scene, scanner, given.seed)
        for scene in injector.SCENES
        for scanner in injector.SCANNERS
    ]
    cases = {name: GROUPS[name](sequences, given.seed) for name in given.groups if name in GROUPS}
    counts = Counts()
    for sequence in sequences:
        if sequence.scene not in given.scenes:
            continue
        known = explainers.healthy_pairs(sequence)
        for group, of_group in cases.items():
            here = [case for case in of_group if case.sequence is sequence]
            for number, case in enumerate(here[:: given.every]):
                _count(case, group, known, _asked(given.explainers, number), counts)
        if CLEAN in given.groups:
            _count_false_alarms(sequence, known, counts)
        print(f"{sequence.scene} {sequence.scanner}: done", flush=True)
    real = real_cases(given.seed)[:: given.every] if REAL in given.groups else ()
    for number, case in enumerate(real):
        clean = explainers.healthy_pairs(case.sequence)
        _count(case, REAL, clean, _asked(given.explainers, number), counts)
    _print(counts)


def _arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=injector.FIRST_SEED)
    parser.add_argument("--scenes", nargs="+", default=injector.SCENES, choices=injector.SCENES)
    groups = (*GROUPS, CLEAN, REAL)
    parser.add_argument("--groups", nargs="+", default=groups, choices=groups)
    parser.add_argument("--explainers", nargs="+", default=EXPLAINERS, choices=EXPLAINERS)
    parser.add_argument("--every", type=int, default=1, help="only every so many cases")
    return parser.parse_args()


def _asked(names, number):
    """The explainers that are asked about the case of this number."""
    return [name for name in names if name != "forward" or number % FORWARD_EVERY == 0]


def _count(case, group, known, names, counts):
    """What each explainer says of a case."""
    if group == "single" and set(case.parts) <= set(injector.TOLD):
        counts.told += 1
        return
    found = effects(case)
    others = [pair for place, pair in enumerate(known) if place != case.pair or group == REAL]
    diagnosis = explainers.diagnosis(case, found.T_reference_source, others)
    if found.first is None:
        counts.without_effect.count(not diagnosis.verdict.causes, (group, "nothing is named"))
        return
    said = {
        "diagnosis": lambda: explainers.surest(diagnosis),
        "removal": lambda: explainers.removed(diagnosis, case, others),
        "ceiling": lambda: explainers.ceiling(case, known[case.pair]),
        "forward": lambda: explainers.forward(case, found.T_reference_source),
    }
    drops = {case.cause(part): drop for part, drop in found.drops.items()}
    true = case.cause(found.first)
    told = {name: said[name]() for name in names}
    for name, first in told.items():
        counts.scores[name].count(first == true, *_groups(case, group, found))
        if group == "mixture" and found.margin > MARGIN:
            counts.drops[name].append(share_of_best_drop(first, drops))
    if group != "mixture":
        level = diagnosis.verdict.levels[true]
        # Of the overlap the injector's levels are shares of what there is.
        level /= known[case.pair].diagnostics.overlap if true == "partial_overlap" else 1.0
        if level > 0:
            counts.levels[found.first].append((case.parts[found.first], level))
    if told.get("diagnosis", true) != true:
        _print_wrong(case, group, found, diagnosis)


def _groups(case, group, found):
    """The groups that a case is counted in."""
    of = case.sequence
    if group == "mixture":
        margins = [margin for margin in (0.0, MARGIN, 0.7) if found.margin > margin]
        return [(group, f"margin above {margin:g}") for margin in margins]
    parts = " + ".join(case.parts)
    return [(group, "all"), *((group, word) for word in (parts, of.scanner, of.scene))]


def _count_false_alarms(sequence, known, counts):
    """Of clean pairs, each against the others."""
    for place, pair in enumerate(known):
        others = [other for k, other in enumerate(known) if k != place]
        named = explainers.diagnose(pair, others).verdict.causes
        counts.false_alarms.count(named, (CLEAN, "all"), (CLEAN, sequence.scanner))
        if named:
            of = f"{sequence.scene} {sequence.scanner} {place}"
            print(f"false alarm, {of}: {', '.join(named)}", flush=True)


def _print_wrong(case, group, found, diagnosis):
    of, verdict = case.sequence, diagnosis.verdict
    parts = ", ".join(f"{part} {level:.3g}" for part, level in case.parts.items())
    drops = ", ".join(f"{part} {drop:.2f}" for part, drop in found.drops.items())
    sure = ", ".join(f"{name} {share:.2f}" for name, share in verdict.probabilities.items())
    z = ", ".join(f"{name} {value:+.1f}" for name, value in diagnosis.z.items())
    print(
        f"wrong, {group} {of.scene} {of.scanner} {case.pair}: {parts}; V falls by {drops}; "
        f"probabilities {sure}; z {z}",
        flush=True,
    )


def _print(counts):
    header = ["group", "of", "cases", "share", "low", "high"]
    for name, score in counts.scores.items():
        if score.number:
            print(f"\n{name}: names the cause that matters most\n")
            print(tabulate(score.rows(), header, "pipe"))
    for title, score in (
        ("clean pairs: something is named", counts.false_alarms),
        ("cases without an effect", counts.without_effect),
    ):
        if score.number:
            print(f"\n{title}\n\n{tabulate(score.rows(), header, 'pipe')}")
    print(f"\ntold, and so not counted: {counts.told} single cases\n")
    rows = [[name, len(pairs), *_level_error(name, pairs)] for name, pairs in counts.levels.items()]
    print(tabulate(rows, ["mechanism", "cases", "median error", "of"], "pipe"))
    print(json.dumps(_json(counts)))


def _level_error(mechanism, pairs):
    """Median error of the diagnosed levels, and of what."""
    true, found = np.array(pairs).T
    if injector.UNKNOWN.get(mechanism, mechanism) == "sensor_noise":
        return f"{np.median(np.abs(found / true - 1)):.1%}", "the true level"
    return f"{np.median(np.abs(found - true)):.3f}", "what is there"


def _json(counts):
    """The keys of the benchmark; null of what was not run."""
    diagnosis, removal = counts.scores["diagnosis"], counts.scores["removal"]
    single, unknown = ("single", "all"), ("unknown", "all")
    mixture = ("mixture", f"margin above {MARGIN:g}")
    drops = counts.drops["removal"]
    values = {
        "single_cases": diagnosis.number.get(single, 0),
        "single_top1": diagnosis.share(single)[0],
        "single_top1_low": diagnosis.share(single)[1],
        "unknown_cases": diagnosis.number.get(unknown, 0),
        "unknown_top1": diagnosis.share(unknown)[0],
        "mixture_cases": removal.number.get(mixture, 0),
        "mixture_top1": removal.share(mixture)[0],
        "mixture_ceiling": counts.scores["ceiling"].share(mixture)[0],
        "mixture_drop": np.mean(drops) if drops else np.nan,
        "false_alarms": counts.false_alarms.share((CLEAN, "all"))[0],
    }
    return {name: _number(value) for name, value in values.items()}


def _number(value):
    if isinstance(value, int):
        return value
    return None if np.isnan(value) else round(float(value), 4)


if __name__ == "__main__":
    main()
