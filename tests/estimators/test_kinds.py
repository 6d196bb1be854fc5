"""What holds for every registered kind of estimator: what it returns is what it says."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from made_examples import made_examples

from icpshap import causes, estimators, options, presets
from icpshap.causes import CAUSES
from icpshap.estimators import KINDS, Estimator
from icpshap.estimators.kind import COVARIANCES, Covariance, Kind, Returns, Samples
from icpshap.estimators.perturb import Perturbation, Streams
from icpshap.options import option
from icpshap.plan import Setting
from icpshap.tables import COVARIANCE, columns

DEVIATION = Perturbation().deviation
STREAMS = Streams(1, "room", 0, 1)
EVERY = pytest.mark.parametrize("kind", KINDS)
NAMES = ("sensor_noise", "partial_overlap")
SETTINGS = [
    Setting.at({"sensor_noise": sigma, "partial_overlap": level})
    for sigma in (0.0, 0.02)
    for level in (0.0, 0.1)
]
FEWER = {"runs": 12, "particles": 12, "iterations": 40, "burn_in": 10, "maximum_iterations": 20}


def estimator(kind, **values):
    given = {"register": "icpshap.registrations:small_gicp"}
    given |= {"subsampling_probability": 0.2, "noise_draws": 2, **values}
    found = Estimator.of(kind, given)
    fewer = {name: FEWER[name] for name in options.names(found.kind) if name in FEWER}
    found = replace(found, kind=replace(found.kind, **fewer))
    if found.kind.training is not None:
        found = found.trained(made_examples(found.kind.fewest_pairs), STREAMS.sequence)
    return found.of_causes(NAMES)


def estimate(pair, settings, of_kind):
    return estimators.estimate(pair, settings, of_kind, DEVIATION, STREAMS)


@EVERY
def test_it_returns_what_it_says_for_every_setting_and_draw(kind, room_pair):
    of_kind = estimator(kind)
    tables = dict(zip(("runs", "estimates"), estimate(room_pair, SETTINGS, of_kind), strict=True))
    returns = of_kind.kind.returns
    assert (tables["runs"] is not None) == returns.samples
    assert (tables["estimates"] is not None) == returns.covariances
    for name, table in tables.items():
        if table is None:
            continue
        known = {column.name for column in columns(name, causes.named(NAMES))}
        assert {*table.columns, "reference", "source"} == known
        number = of_kind.number_of_runs if name == "runs" else of_kind.perturbing.noise_draws
        assert len(table) == len(SETTINGS) * number
        for _, part in table.groupby(list(NAMES)):
            numbers = part["run" if name == "runs" else "noise_draw"]
            assert sorted(numbers) == list(range(number))


@EVERY
def test_weights_are_those_of_every_setting_with_mean_one(kind, room_pair):
    runs, _ = estimate(room_pair, SETTINGS, estimator(kind))
    if runs is not None:
        weights = [part["weight"].to_numpy() for _, part in runs.groupby(list(NAMES))]
        assert all(np.array_equal(weights[0], other) for other in weights)
        assert weights[0].mean() == pytest.approx(1.0)


@EVERY
def test_a_setting_does_not_depend_on_what_else_is_estimated(kind, room_pair):
    together = estimate(room_pair, SETTINGS, estimator(kind))
    alone = estimate(room_pair, SETTINGS[-1:], estimator(kind))
    for whole, part in zip(together, alone, strict=True):
        if whole is not None:
            last = whole.tail(len(part)).reset_index(drop=True)
            assert last.equals(part.reset_index(drop=True))


@EVERY
def test_its_options_are_described_and_clash_with_none(kind):
    names = presets.option_names(kind)
    assert len(set(names)) == len(names)
    for owner in presets.owners(kind):
        for name, schema in options.properties(owner).items():
            assert schema["description"].endswith("."), name
    assert set(KINDS[kind].sees or ()) <= set(CAUSES)


@EVERY
def test_what_decides_it_makes_it_again(kind):
    of_kind = estimator(kind)
    assert Estimator.decided(of_kind.decides()) == of_kind


# --- kinds made for the test ----------------------------------------------------------------------


@dataclass(frozen=True)
class Constant(Kind):
    """One covariance whatever the data say."""

    name: ClassVar = "constant"
    returns: ClassVar = COVARIANCES
    deviation: float = option(0.01, "Standard deviation of everything", unit="-", above=0)

    def estimate(self, group):
        for start in group.starts:
            T, covariance = group.pair.T_reference_source, self.deviation**2 * np.eye(6)
            yield Covariance(start.setting, group.noise_draw, T, covariance)


@dataclass(frozen=True)
class Both(Kind):
    """Every start a sample, and a covariance besides."""

    name: ClassVar = "both"
    returns: ClassVar = Returns(samples=True, covariances=True)

    def number_of_runs(self, noise_draws):
        return 3 * noise_draws

    def estimate(self, group):
        for start in group.starts:
            number = len(group.runs)
            none = np.zeros(number)
            yield Samples(
                start.setting, group.noise_draw, group.runs, start.T_initial, start.initial_xi,
                none.astype(int), np.full(number, "ok"), none, none,
            )  # fmt: skip
            T = group.pair.T_reference_source
            yield Covariance(start.setting, group.noise_draw, T, np.eye(6))


@pytest.mark.parametrize("kind", [Constant, Both])
def test_the_contract_holds_for_covariances_and_for_both(kind, room_pair, monkeypatch):
    monkeypatch.setitem(KINDS, kind.name, kind)
    for check in (
        test_it_returns_what_it_says_for_every_setting_and_draw,
        test_weights_are_those_of_every_setting_with_mean_one,
        test_a_setting_does_not_depend_on_what_else_is_estimated,
    ):
        check(kind.name, room_pair)
    test_what_decides_it_makes_it_again(kind.name)


def test_a_kind_that_returns_something_else_is_refused(room_pair, monkeypatch):
    """Not dropped: what was computed and is not declared would be lost without a word."""

    class Lying(Constant):
        name = "lying"
        returns = Returns(samples=True, covariances=False)

    monkeypatch.setitem(KINDS, "lying", Lying)
    with pytest.raises(TypeError, match=r"lying returned covariances alone, .* says samples alone"):
        estimate(room_pair, SETTINGS, estimator("lying"))


def test_a_covariance_is_written_as_its_upper_triangle(room_pair):
    generator = np.random.default_rng(0)
    factor = generator.normal(size=(6, 6))
    expected = factor @ factor.T

    class Random(Constant):
        def estimate(self, group):
            for start in group.starts:
                yield Covariance(start.setting, group.noise_draw, np.eye(4), expected)

    of_kind = replace(estimator("monte_carlo"), kind=Random())
    _, table = estimate(room_pair, SETTINGS[:1], of_kind)
    row, column = np.triu_indices(6)
    np.testing.assert_array_equal(table[COVARIANCE].to_numpy()[0], expected[row, column])
