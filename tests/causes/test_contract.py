"""What holds for every registered cause, whichever it is: a new one is tested by being there."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from icpshap import causes, options
from icpshap.causes import CAUSES
from icpshap.causes.cause import HOOKS, SCANS, Cause
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Draws, Streams, groups
from icpshap.plan import Setting

EVERY = pytest.mark.parametrize("cause", CAUSES.values(), ids=CAUSES)
STREAMS = Streams(1, "room", 0, 1)
DEVIATION = np.repeat([0.1, 0.1], 3)
RUNS = 6


@dataclass(frozen=True)
class Recording(Streams):
    """Streams that remember which were asked for."""

    asked: list = field(default_factory=list)

    def generator(self, name):
        self.asked.append(name)
        return super().generator(name)


def estimator(*names, **values):
    values = {"noise_draws": 2, "subsampling_probability": 0.3, **values}
    found = Estimator.of("monte_carlo", {"runs": 100, **values})
    return found.of_causes(names)


def acted(pair, setting, streams=STREAMS, names=None):
    """All that an estimator gets of a setting, as arrays."""
    of_setting = estimator(*(names or setting.values))
    parts = []
    for group in groups(pair, [setting], of_setting, DEVIATION, streams):
        (start,) = group.starts
        parts += [group.reference, start.source, start.usable, start.initial_xi, *start.rows]
    return parts


def same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@EVERY
def test_its_words_are_complete(cause):
    assert cause.name.isidentifier() and cause.name == cause.name.lower()
    assert cause.title and cause.symbol and cause.meaning and cause.colour.startswith("#")
    assert not cause.meaning.endswith(".")
    assert len(cause.levels) >= 2 and cause.off not in cause.levels
    for level in (cause.off, *cause.levels):
        keywords = cause.range.schema
        assert level >= keywords.get("minimum", -np.inf)
        assert level > keywords.get("exclusiveMinimum", -np.inf)
        assert level <= keywords.get("maximum", np.inf)
        assert level < keywords.get("exclusiveMaximum", np.inf)
    assert set(cause.scans) <= set(SCANS)


def test_names_colours_and_options_are_their_own():
    assert len({cause.colour for cause in CAUSES.values()}) == len(CAUSES)
    names = [name for cause in CAUSES.values() for name in options.names(cause)]
    assert len(set(names)) == len(names)


@EVERY
def test_it_acts_through_one_hook(cause):
    overridden = [hook for hook in HOOKS if getattr(cause, hook) is not getattr(Cause, hook)]
    assert overridden == [cause.hook()]


@EVERY
def test_off_changes_nothing_to_the_bit(cause, room_pair):
    named_off = acted(room_pair, Setting.at({cause.name: cause.off}))
    assert same(named_off, acted(room_pair, Setting.at({})))


@EVERY
def test_the_hook_itself_does_nothing_at_off(cause, room_pair):
    instance, draws = cause(), draws_of(room_pair)
    rows = np.arange(0, len(room_pair.source), 3, dtype=np.int32)
    for scan in cause.scans:
        points = getattr(room_pair, scan)
        moved = instance.move(points, scan, cause.off, 0, draws.streams)
        np.testing.assert_array_equal(moved, points)
        kept = instance.keep(room_pair, scan, cause.off, 0, draws.streams)
        assert kept is None or kept.all()
    np.testing.assert_array_equal(instance.start(DEVIATION, cause.off), DEVIATION)
    left = instance.thin(rows, 0, cause.off, len(room_pair.source), draws.streams)
    np.testing.assert_array_equal(left, rows)


def draws_of(pair, streams=STREAMS):
    return Draws(pair, estimator(), DEVIATION, streams)


@EVERY
def test_it_changes_something_when_on(cause, room_pair):
    assert not same(
        acted(room_pair, Setting.at({cause.name: cause.levels[-1]})),
        acted(room_pair, Setting.at({cause.name: cause.off})),
    )


@EVERY
def test_the_same_level_does_the_same_each_time(cause, room_pair):
    setting = Setting.at({cause.name: cause.levels[0]})
    assert same(acted(room_pair, setting), acted(room_pair, setting))


@EVERY
def test_a_larger_level_removes_more_of_the_same(cause, room_pair):
    """Masks are nested: what a level removes, every larger one removes, too."""
    far_from_off = sorted(cause.levels, key=lambda level: abs(level - cause.off))
    instance = cause()
    for less, more in pairwise(far_from_off):
        if cause.hook() == "keep":
            for scan in cause.scans:
                masks = [
                    instance.keep(room_pair, scan, level, 0, STREAMS) for level in (less, more)
                ]
                assert not (masks[1] & ~masks[0]).any()
        if cause.hook() == "thin":
            count = len(room_pair.source)
            rows = [
                instance.thin(np.arange(count), 3, level, count, STREAMS) for level in (less, more)
            ]
            assert set(rows[1]) <= set(rows[0])


@EVERY
def test_a_level_scales_the_same_draw(cause, room_pair):
    """Moves and starts are one direction, scaled: levels draw nothing of their own.

    A move that draws nothing, such as rounding, has no draw to scale.
    """
    less, more = cause.levels[0], cause.levels[-1]
    instance = cause()
    if cause.hook() == "move":
        for scan in cause.scans:
            points, streams = getattr(room_pair, scan), Recording(1, "room", 0, 1)
            away = [
                (instance.move(points, scan, level, 0, streams) - points).ravel()
                for level in (less, more)
            ]
            assert not streams.asked or np.corrcoef(*away)[0, 1] > 0.9
    if cause.hook() == "start":
        ratio = instance.start(DEVIATION, more) / instance.start(DEVIATION, less)
        assert np.allclose(ratio, ratio[0])


@EVERY
def test_its_random_numbers_are_its_own(cause, room_pair):
    """No stream of a cause is one that something else draws from, nor does a level change it."""
    without = Recording(1, "room", 0, 1)
    acted(room_pair, Setting.at({}), without)
    asked = {}
    for name, other in CAUSES.items():
        for level in other.levels:
            streams = Recording(1, "room", 0, 1)
            acted(room_pair, Setting.at({name: level}), streams)
            of_level = set(streams.asked) - set(without.asked)
            assert asked.setdefault(name, of_level) == of_level
    others = set().union(*(found for name, found in asked.items() if name != cause.name))
    assert not asked[cause.name] & others


@EVERY
def test_masks_are_those_of_the_raw_scans(cause, room_pair):
    """What moves the points changes no mask."""
    if cause.hook() != "keep":
        return
    level = cause.levels[-1]
    moves = {name: c.levels[0] for name, c in CAUSES.items() if c.hook() == "move"}
    draws = Draws(room_pair, estimator(cause.name, *moves), DEVIATION, STREAMS)
    for scan in cause.scans:
        alone = draws.kept(Setting.at({cause.name: level}), scan, 0)
        moved = draws.kept(Setting.at({cause.name: level, **moves}), scan, 0)
        np.testing.assert_array_equal(alone, moved)


def test_the_order_in_which_causes_are_named_does_not_matter(room_pair):
    levels = {name: cause.levels[0] for name, cause in CAUSES.items()}
    first = acted(room_pair, Setting.at(levels))
    generator = np.random.default_rng(1)
    for _ in range(6):
        names = generator.permutation(list(levels)).tolist()
        assert same(first, acted(room_pair, Setting.at({name: levels[name] for name in names})))
        assert causes.named(names) == causes.named(levels)


def test_the_initial_poses_depend_on_the_causes_that_move_them_alone(room_pair):
    levels = {name: cause.levels[0] for name, cause in CAUSES.items()}
    starting = {name: levels[name] for name, c in CAUSES.items() if c.hook() == "start"}
    alone, every = (acted(room_pair, Setting.at(values))[3] for values in (starting, levels))
    np.testing.assert_array_equal(alone, every)


def test_any_causes_compose_and_leave_one_another_alone(room_pair):
    """What is off is as what is not named, and masks add up, whichever others are on."""
    levels = {name: cause.levels[0] for name, cause in CAUSES.items()}
    for left_out in levels:
        some = {name: level for name, level in levels.items() if name != left_out}
        setting = Setting.at(some)
        assert same(acted(room_pair, setting), acted(room_pair, setting, names=levels))
    draws = Draws(room_pair, estimator(*levels), DEVIATION, STREAMS)
    for scan in SCANS:
        alone = [draws.kept(Setting.at({name: levels[name]}), scan, 1) for name in levels]
        together = draws.kept(Setting.at(levels), scan, 1)
        np.testing.assert_array_equal(together, np.all(alone, axis=0))
