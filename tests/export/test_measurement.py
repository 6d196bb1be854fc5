"""What of a covariances table is exported."""

import numpy as np
import pytest
from known_measurements import OFF, ON, POSES, covariance, table

from icpshap.errors import UserError
from icpshap.export import clean, export
from icpshap.export.measurement import at, coalitions, instance, measurements, of_sequence

GRID = ((0.0, 0.02, 0.05), (1.0, 1.5))


def test_a_measurement_has_the_numbers_of_its_row():
    found = measurements(table())
    assert len(found) == 3 * 4  # without the second clean sample
    (first,) = [one for one in found if one.levels == ON and one.reference == 0]
    assert (first.sequence, first.source, first.n_used, first.n_runs) == ("drive", 1, 98, 100)
    assert first.T_reference_source.tobytes() == POSES[0].tobytes()
    assert first.covariance.tobytes() == covariance(0, 4).tobytes()


def test_replicates_are_averaged():
    first = measurements(table(replicates=2))[0]
    np.testing.assert_allclose(first.covariance, 1.5 * covariance(0), rtol=1e-12)
    assert first.n_used == 196


def test_all_causes_are_on_unless_another_level_is_asked_for():
    found = measurements(table())
    assert instance(found, {}) == ON
    assert instance(found, {"sensor_noise": 0.0}) == {**ON, "sensor_noise": 0.0}
    assert instance(found, clean()) == OFF
    assert len(at(found, ON)) == 3
    assert len(coalitions(found, ON)) == 12


def test_of_a_grid_one_instance_is_asked_for():
    found = measurements(table(GRID))
    told = r"sensor_noise: the table has the levels 0, 0\.02, 0\.05, expected one\."
    with pytest.raises(UserError, match=rf"{told}\nHint: --sensor-noise 0\.05"):
        instance(found, {})
    chosen = instance(found, {"sensor_noise": 0.05})
    assert len(coalitions(found, chosen)) == 12


@pytest.mark.parametrize("asked", [{"sensor_noise": 0.03}, {"range_bias": 0.01}])
def test_what_was_not_run_cannot_be_asked_for(asked):
    with pytest.raises(UserError, match=r"not in the table, expected one of 0[\s\S]*Hint"):
        instance(measurements(table()), asked)


def test_a_sequence_is_chosen_by_its_key():
    found = measurements(table(sequences=("drive", "other")))
    assert len(of_sequence(found, None)) == 2 * len(of_sequence(found, "other"))
    with pytest.raises(UserError, match="expected one of drive, other"):
        of_sequence(found, "nowhere")


def test_what_has_no_covariance_is_left_out_and_named():
    frame = table()
    frame.loc[frame["reference"] == 1, "covariance_00"] = np.nan
    texts, (lost, runs) = export(frame, "g2o", {})
    assert lost == "1 pair(s) without a covariance are left out, the first is drive 1-2."
    assert runs.startswith("The covariances leave out up to 2% of the runs (drive 0-1)")
    assert texts[""].count("EDGE_SE3:QUAT") == 2
    frame["covariance_00"] = np.nan
    with pytest.raises(UserError, match=r"none of which has a covariance[\s\S]*Hint"):
        export(frame, "g2o", {})
