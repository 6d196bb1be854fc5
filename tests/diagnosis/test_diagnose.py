from dataclasses import replace

import corridors
import numpy as np
import pandas as pd
import pytest

from icpshap import causes, se3, tables
from icpshap.causes import CAUSES
from icpshap.diagnosis import curves
from icpshap.diagnosis.diagnose import NONE, OTHERS, SHEET, Known, diagnose, diagnose_alone
from icpshap.diagnosis.diagnostics import NUMBERS
from icpshap.diagnosis.table import row_of
from icpshap.diagnosis.verdict import FOUND, NOTHING, UNKNOWN


def known(pair, place=0):
    return Known(lambda: pair, corridors.streams(place))


@pytest.fixture(scope="module")
def others():
    return [known(corridors.pair(seed), seed) for seed in range(1, 6)]


def noisy(sigma):
    pair = corridors.pair()
    generator = np.random.default_rng(7)
    return replace(
        pair,
        reference=pair.reference + generator.normal(0, sigma, pair.reference.shape),
        source=pair.source + generator.normal(0, sigma, pair.source.shape),
    )


def hidden():
    """What lies to the left of the source is hidden."""
    pair = corridors.pair()
    return replace(pair, source=pair.source[pair.source[:, 1] < 0.5])


def bare():
    """Without the wall at the end of the corridor."""
    pair = corridors.pair()
    reference = pair.reference[pair.reference[:, 0] < corridors.LENGTH - 0.1]
    source = pair.source[pair.source[:, 0] < corridors.LENGTH - 0.4]
    return replace(pair, reference=reference, source=source)


@pytest.mark.parametrize("name", causes.shown())
def test_the_least_level_changes_its_own_diagnostic_as_it_should(others, name):
    curve = others[0].curves[name]
    assert (curve.changes[0] == 0).all()
    own = curve.direction * curve.changes[:, curve.own]
    assert own[-1] > 0.3
    assert curve.direction == (1 if name == "sensor_noise" else -1)


@pytest.mark.parametrize("name", causes.shown())
def test_a_level_comes_back_from_what_it_does(others, name):
    curve = others[0].curves[name]
    assert curve.level(curve.changes[2]) == pytest.approx(curve.levels[2], rel=0.02)


def test_every_cause_that_scans_show_moves_a_number_that_is_measured():
    assert {CAUSES[name].shown_by for name in causes.shown()} <= set(NUMBERS)
    assert not any(CAUSES[name].told for name in causes.shown())


def test_a_cause_that_is_off_leaves_the_pair_as_it_is():
    pair = corridors.pair()
    for name in causes.shown():
        cause = CAUSES[name](**curves.OPTIONS.get(name, {}))
        found = curves.perturbed(cause, pair, cause.off, corridors.streams())
        assert (found.reference == pair.reference).all() and (found.source == pair.source).all()


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_noise_is_found_and_how_much(others, sigma):
    found = diagnose(known(noisy(sigma)), others)
    assert found.verdict.said[:2] == (FOUND, ["sensor_noise"])
    assert found.verdict.levels["sensor_noise"] == pytest.approx(sigma, rel=0.15)
    assert found.z["sensor_noise"] > 5


def test_a_hidden_part_is_a_lack_of_overlap(others):
    found = diagnose(known(hidden()), others)
    assert "partial_overlap" in found.verdict.said[1]
    assert found.z["partial_overlap"] > 5


def test_a_bare_corridor_is_under_constrained(others):
    found = diagnose(known(bare()), others)
    assert found.verdict.said[:2] == (FOUND, ["under_constrained"])
    assert found.z["under_constrained"] > 5


def test_a_healthy_pair_is_healthy(others):
    found = diagnose(known(corridors.pair()), others)
    assert found.verdict.said[0] == NOTHING
    assert (found.against, found.number) == (OTHERS, 5)


def test_a_sheet_says_how_much_noise_is_usual():
    quiet, loud = (
        diagnose_alone(known(pair), "hokuyo_utm_30lx") for pair in (noisy(0.01), noisy(0.2))
    )
    assert (quiet.against, quiet.verdict.said[0]) == (SHEET, NOTHING)
    assert loud.verdict.said[:2] == (FOUND, ["sensor_noise"])
    assert np.isnan(loud.verdict.levels["partial_overlap"])


def test_a_pair_alone_has_nothing_to_be_held_against():
    found = diagnose_alone(known(corridors.pair()), None)
    assert (found.against, found.verdict.said[0]) == (NONE, UNKNOWN)


def test_pairs_that_cannot_be_measured_are_no_healthy_ones(others):
    far = se3.exp(np.array([0, 0, 0, 90.0, 0, 0]))
    apart = replace(corridors.pair(), T_reference_source=far)
    assert diagnose(known(apart), others).verdict.said[0] == UNKNOWN
    assert diagnose(others[0], [known(apart)]).against == NONE
    assert diagnose(others[0], [known(apart), *others[1:]]).number == 4


def test_the_table_is_that_of_the_workflow(tmp_path):
    pairs = [corridors.pair(seed) for seed in range(3)]
    measured = [known(pair, place) for place, pair in enumerate(pairs)]
    found = pd.DataFrame([row_of(measured, place) for place in range(3)])
    tables.write(tmp_path / "diagnosis.parquet", found, "diagnosis")
    again = tables.read(tmp_path / "diagnosis.parquet", "diagnosis")
    assert list(again.reference) == [0, 1, 2] and (again.healthy_pairs == 2).all()
    assert (again.healthiest_reference != again.reference).all()
    assert (again.weakest.str.startswith("along x")).all()
