from dataclasses import replace

import corridors
import numpy as np
import pytest

from icpshap import se3
from icpshap.diagnosis.curves import of_pair, reference_of


@pytest.fixture(scope="module")
def pair():
    return corridors.pair()


def test_the_weakest_direction_of_a_corridor_is_along_it(pair):
    found = of_pair(pair)
    assert abs(found.direction[3]) > 0.95
    assert 0 < found.weakest_information < 1 / 6


def test_the_overlap_is_that_of_the_pair(pair):
    assert of_pair(pair).overlap == pair.overlap


def test_turning_the_scanner_changes_nothing(pair):
    turned = corridors.pair(turn=0.7)
    assert of_pair(turned).logarithms == pytest.approx(of_pair(pair).logarithms, abs=0.02)


def test_points_within_the_minimum_range_do_not_count(pair):
    near, far = (np.linalg.norm(pair.reference, axis=1) <= 3.0).sum(), len(pair.reference)
    assert of_pair(pair.for_chain(3.0)).reference_points == far - near


def test_half_a_source_is_half_the_overlap(pair):
    half = replace(pair, source=pair.source[pair.source[:, 0] > 0])
    assert of_pair(half).overlap == pytest.approx(0.5 * pair.overlap, rel=0.1)


def test_scans_apart_have_an_overlap_and_nothing_else(pair):
    away = replace(pair, T_reference_source=se3.exp(np.array([0, 0, 0, 0, 0, 50.0])))
    found = of_pair(away)
    assert not found.are_known
    assert found.overlap == 0 and np.isnan(found.weakest_information)


def test_the_same_scans_give_the_same_bytes(pair):
    first, second = of_pair(pair), of_pair(pair)
    assert first.logarithms.tobytes() == second.logarithms.tobytes()


def test_a_reference_serves_any_source_to_the_byte(pair):
    known = reference_of(pair)
    for share in (0.3, 1.0):
        part = replace(pair, source=pair.source[: int(share * len(pair.source))])
        assert of_pair(part, known).logarithms.tobytes() == of_pair(part).logarithms.tobytes()
