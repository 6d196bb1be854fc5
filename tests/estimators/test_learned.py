"""Covariances of the nearest examples: predicted, described, and learned from other sequences."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from estimated_room import DEVIATION, STREAMS
from made_examples import made_examples

from icpshap import estimators, se3
from icpshap.data.pair import Pair
from icpshap.estimators import Estimator
from icpshap.estimators._descriptors import CELL, DIRECTIONS, Cells, descriptor
from icpshap.estimators.learned import Examples, Learned, TrainingError, predict
from icpshap.explanation import training
from icpshap.explanation.method import Method
from icpshap.explanation.scan_pair import ScanPair
from icpshap.plan import Setting
from icpshap.tables import COVARIANCE, DESCRIPTOR, columns

SCALED = np.arange(1.0, 4.0)


def scaled_identities(factors):
    return np.multiply.outer(factors, np.eye(6))


class TestPrediction:
    def test_is_the_mean_weighted_by_the_distance(self):
        """Distances 0, 1 and 3 of entries as they are: weights 1, e^-1 and e^-3."""
        seen = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 3.0]])
        examples = Examples(seen, np.ones(2), scaled_identities([2.0, 5.0, 11.0]))
        weights = np.exp([0.0, -1.0, -3.0])
        expected = weights @ [2.0, 5.0, 11.0] / weights.sum()
        found = predict(examples, np.zeros(2), neighbours=3)
        assert found == pytest.approx(expected * np.eye(6))

    def test_looks_at_the_nearest_alone(self):
        seen = np.array([[5.0], [0.0], [1.0]])
        examples = Examples(seen, np.ones(1), scaled_identities([1e9, 2.0, 4.0]))
        expected = (2.0 + 4.0 * np.exp(-1)) / (1 + np.exp(-1))
        found = predict(examples, np.zeros(1), neighbours=2)
        assert found == pytest.approx(expected * np.eye(6))

    def test_an_entry_counts_by_how_much_it_varies_over_the_examples(self):
        generator = np.random.default_rng(0)
        seen = generator.standard_normal((40, 3))
        matrices = scaled_identities(generator.uniform(1, 2, 40))
        unit = np.array([1.0, 1000.0, 1e-3])
        one, other = Examples.of(seen, matrices), Examples.of(seen * unit, matrices)
        found = predict(one, seen[0] + 0.1, 12)
        assert predict(other, (seen[0] + 0.1) * unit, 12) == pytest.approx(found)
        assert one.descriptors.std(axis=0) == pytest.approx(np.ones(3))

    def test_an_entry_in_which_the_examples_do_not_differ_tells_nothing(self):
        seen = np.array([[0.1, 0.0], [0.1, 1.0], [0.1, 3.0]])
        examples = Examples.of(seen, scaled_identities(SCALED))
        found = [predict(examples, np.array([value, 0.5]), 2) for value in (0.1, 7.0)]
        assert np.array_equal(*found)

    def test_a_pair_unlike_any_other_has_a_covariance_too(self):
        examples = Examples(np.zeros((3, 1)), np.ones(1), scaled_identities(SCALED))
        assert predict(examples, np.array([1e6]), 3) == pytest.approx(2 * np.eye(6))

    def test_of_definite_matrices_is_definite(self):
        generator = np.random.default_rng(1)
        factors = generator.standard_normal((30, 6, 6))
        matrices = (
            factors @ np.swapaxes(factors, 1, 2) * 10.0 ** generator.uniform(-12, 0, (30, 1, 1))
        )
        examples = Examples.of(generator.standard_normal((30, 4)), matrices)
        for seen in generator.standard_normal((20, 4)):
            np.linalg.cholesky(predict(examples, seen, 12))

    def test_of_a_smooth_function_of_the_scene_beats_the_mean(self):
        def covariance(values):
            return np.exp(values[0]) * np.diag([1, 1, 1, 4, 4, 4]) * 1e-4

        table = made_examples(400, covariance)
        table[DESCRIPTOR[2:]] = 0.0  # a scene has two numbers here
        learned = Learned(neighbours=12).trained(table, "mine")
        mean = learned.examples.covariances.mean(axis=0)
        errors = {"predicted": [], "mean": []}
        for values in np.random.default_rng(5).standard_normal((100, len(DESCRIPTOR))):
            true = covariance(values)
            for name, found in (
                ("predicted", predict(learned.examples, values, 12)),
                ("mean", mean),
            ):
                errors[name].append(np.log(found[0, 0] / true[0, 0]) ** 2)
        assert np.mean(errors["predicted"]) < 0.1 * np.mean(errors["mean"])


# --- the descriptor -------------------------------------------------------------------------------


def of_pair(pair):
    found = descriptor(pair.reference, pair.source, pair.T_reference_source)
    return dict(zip(DESCRIPTOR, found, strict=True))


def noisy(pair, sigma):
    generator = np.random.default_rng(8)
    clouds = [
        points + sigma * generator.standard_normal(points.shape)
        for points in (pair.reference, pair.source)
    ]
    return Pair.measured(*clouds, pair.T_reference_source, pair.overlap_distance)


class TestDescriptor:
    def test_has_the_entries_of_the_table(self, room_pair):
        assert len(of_pair(room_pair)) == len(DESCRIPTOR)
        assert np.isfinite(list(of_pair(room_pair).values())).all()
        shown = {column.name for column in columns("descriptors")}
        assert {*DESCRIPTOR, *COVARIANCE} < shown

    def test_does_not_depend_on_the_order_of_points(self, room_pair):
        pair, generator = noisy(room_pair, 0.01), np.random.default_rng(2)
        clouds = [generator.permutation(pair.reference), generator.permutation(pair.source)]
        shuffled = Pair.measured(*clouds, pair.T_reference_source, 0.2)
        assert of_pair(shuffled) == pytest.approx(of_pair(pair), rel=1e-9, abs=1e-12)

    def test_does_not_depend_on_the_frame_of_the_reference(self, room_pair):
        """It is in the axes of the source, as the covariance is."""
        pair, T = noisy(room_pair, 0.01), se3.exp([0.4, 0.1, -0.3, 5.0, -2.0, 1.0])
        turned = se3.transform(T, pair.reference)
        turned = Pair.measured(turned, pair.source, T @ pair.T_reference_source, 0.2)
        assert of_pair(turned) == pytest.approx(of_pair(pair), rel=1e-9, abs=1e-12)

    def test_noise_makes_surfaces_thicker(self, room_pair):
        quartiles = [
            [of_pair(noisy(room_pair, sigma))[f"thickness_{k}"] for k in (1, 2)]
            for sigma in (0.0, 0.02, 0.05)
        ]
        assert (np.diff(quartiles, axis=0) > 0.005).all()

    def test_of_a_plane_is_flat_with_one_normal(self):
        """Points of z = 0.3, 4 m by 4 m: moments of a square, a histogram with one bin."""
        axis = (np.arange(80) + 0.5) / 20 - 2
        points = np.stack(np.meshgrid(axis, axis, [0.3]), axis=-1).reshape(-1, 3)
        found = dict(zip(DESCRIPTOR, descriptor(points, points, np.eye(4)), strict=True))
        expected = {
            "mean_x": 0.0,
            "mean_z": 0.3,
            "spread_xx": 4**2 / 12 * (1 - 1 / 80**2),
            "spread_xy": 0.0,
            "spread_zz": 0.0,
            "shape_linear": 0.0,
            "shape_planar": 1.0,
            "thickness_3": 0.0,
            "log_cells": np.log(64),
            "log_source_points": np.log(6400),
            "shared_reference_points": 1.0,
        }
        assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-7)
        up = int(np.argmax(DIRECTIONS @ [0, 0, 1]))
        assert [found[f"normals_{k}"] for k in range(13)] == pytest.approx(np.eye(13)[up])

    def test_of_clouds_that_hardly_overlap_there_is_none(self, room_pair):
        apart = se3.exp([0, 0, 0, 100.0, 0, 0])
        assert descriptor(room_pair.reference, room_pair.source, apart) is None
        nothing = np.zeros((0, 3))
        assert descriptor(room_pair.reference, nothing, np.eye(4)) is None

    def test_directions_are_those_of_lines_not_of_rays(self):
        assert len(DIRECTIONS) == 13
        assert np.abs(DIRECTIONS @ DIRECTIONS.T - np.eye(13)).max() < 0.9

    def test_cells_hold_what_numpy_says_of_their_points(self):
        points = np.random.default_rng(4).uniform(-1, 1, (500, 3))
        cells = Cells.of(points)
        assert cells.number.sum() == 500
        place = np.floor(points[0] / CELL)
        inside = points[(np.floor(points / CELL) == place).all(axis=1)]
        (row,) = np.flatnonzero((np.floor(cells.mean / CELL) == place).all(axis=1))
        assert cells.mean[row] == pytest.approx(inside.mean(axis=0))
        assert cells.covariance[row] == pytest.approx(np.cov(inside.T, bias=True))


# --- learned from other sequences -----------------------------------------------------------------

SETTINGS = [
    Setting.at({"sensor_noise": sigma, "initial_pose": scale})
    for sigma in (0.0, 0.05)
    for scale in (1.0, 1.5)
]
CAUSES = ("sensor_noise", "initial_pose")


def estimated(pair, table, sequence="room"):
    estimator = Estimator.of("learned", {"subsampling_probability": 0.2})
    estimator = estimator.trained(table, sequence).of_causes(CAUSES)
    runs, found = estimators.estimate(pair, SETTINGS, estimator, DEVIATION, STREAMS)
    assert runs is None
    return found


class TestLeaveOneSequenceOut:
    def test_its_own_pairs_have_no_influence(self, room_pair):
        others = made_examples(40)
        absurd = made_examples(40, lambda values: 1e9 * np.eye(6), sequence="room", seed=1)
        both = pd.concat([absurd, others])
        expected = estimated(room_pair, others)
        assert expected.equals(estimated(room_pair, both))
        assert not expected.equals(estimated(room_pair, both, sequence="elsewhere"))

    def test_fewer_than_30_pairs_of_others_are_refused(self):
        table = pd.concat([made_examples(29), made_examples(40, sequence="room")])
        message = (
            r"^same_perturbation has runs of 29 pairs of other sequences than room to learn from, "
            r"expected at least 30.\nHint: more sequences"
        )
        with pytest.raises(TrainingError, match=message):
            Learned().trained(table, "room")
        Learned().trained(made_examples(30), "room")

    def test_settings_of_one_pair_are_one_pair(self):
        table = pd.concat([made_examples(29, seed=seed) for seed in range(3)])
        with pytest.raises(TrainingError, match="29 pairs"):
            Learned().trained(table, "room")

    def test_without_training_it_says_what_is_missing(self, room_pair):
        estimator = Estimator.of("learned", {}).of_causes(CAUSES)
        with pytest.raises(TrainingError, match=r"was not trained.\nHint: call trained\(table"):
            estimators.estimate(room_pair, SETTINGS, estimator, DEVIATION, STREAMS)


class TestEstimates:
    def test_the_same_to_the_byte(self, room_pair):
        table = made_examples(40, lambda values: np.exp(values[20]) * np.eye(6))
        one, other = (estimated(room_pair, table) for _ in range(2))
        assert one[COVARIANCE].to_numpy().tobytes() == other[COVARIANCE].to_numpy().tobytes()

    def test_initial_poses_are_not_seen(self, room_pair):
        table = made_examples(40, lambda values: np.exp(values[20]) * np.eye(6))
        found = estimated(room_pair, table)[COVARIANCE].to_numpy()
        assert np.array_equal(found[0], found[1]) and np.array_equal(found[2], found[3])
        assert not np.array_equal(found[0], found[2])

    def test_where_clouds_hardly_overlap_it_is_degenerate(self, room_pair):
        apart = replace(room_pair, T_reference_source=se3.exp([0, 0, 0, 100.0, 0, 0]))
        found = estimated(apart, made_examples(40))
        assert set(found["status"]) == {"degenerate"}
        assert found[COVARIANCE].isna().all(axis=None)


# --- what is learned from -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(room_pair):
    values = {"runs": 50, "subsampling_probability": 0.2, "maximum_iterations": 20}
    teacher = Estimator.of("monte_carlo", values).of_causes(CAUSES)
    again = Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0}, again=True)
    settings = [again, *SETTINGS]
    runs, _ = estimators.estimate(room_pair, settings, teacher, DEVIATION, STREAMS)
    scan_pair = ScanPair("room", 0, 1, 3.0, room_pair.T_reference_source)
    method = Method()
    table = training.examples(room_pair, settings, teacher, STREAMS, runs, None, method, scan_pair)
    return runs, table


class TestExamples:
    def test_are_the_settings_without_the_second_clean_one(self, made):
        _, table = made
        shown = [column.name for column in columns("descriptors", estimators.named(CAUSES))]
        assert sorted(table.columns) == sorted(shown)
        assert table[list(CAUSES)].to_numpy().tolist() == [
            list(setting.values.values()) for setting in SETTINGS
        ]

    def test_hold_the_covariance_of_the_runs_with_the_floor(self, made):
        runs, table = made
        last = runs[(runs["sensor_noise"] == 0.05) & (runs["initial_pose"] == 1.5)]
        xi = last[[f"xi_{k}" for k in range(6)]].to_numpy()
        expected = (np.cov(xi.T) + 1e-12 * np.eye(6))[np.triu_indices(6)]
        assert table.iloc[-1][COVARIANCE].to_numpy(dtype=float) == pytest.approx(expected)

    def test_hold_what_the_estimator_sees_of_the_same_clouds(self, made, room_pair):
        """So that each example is at distance 0 of itself."""
        _, table = made
        others = made_examples(40)
        for name in CAUSES:
            others[name] = 0.0
        together = pd.concat([table.assign(sequence="taught"), others])
        learned = Estimator.of("learned", {"neighbours": 1}).trained(together, "room")
        _, found = estimators.estimate(
            room_pair, SETTINGS, learned.of_causes(CAUSES), DEVIATION, STREAMS
        )
        # Settings of which only the initial poses differ look the same: the first one counts.
        expected = table[COVARIANCE].to_numpy()[[0, 0, 2, 2]]
        assert found[COVARIANCE].to_numpy() == pytest.approx(expected, rel=1e-12)

    def test_the_sensors_own_noise_is_in_the_covariance_alone(self, room_pair):
        values = {"sensor_sigma": 0.05, "noise_draws": 10, "runs": 50}
        drawing = Estimator.of("monte_carlo", values).of_causes(CAUSES)
        plain = Estimator.of("monte_carlo", {**values, "sensor_sigma": 0.0}).of_causes(CAUSES)
        found, expected = (
            training.mean_descriptors(room_pair, SETTINGS, teacher, STREAMS)
            for teacher in (drawing, plain)
        )
        for setting in SETTINGS:
            assert np.array_equal(found[setting], expected[setting])
