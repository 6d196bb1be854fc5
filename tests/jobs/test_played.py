"""What is played of each pair: of the plan's levels, or of what was diagnosed."""

import numpy as np
import pandas as pd
import pytest

from icpshap import causes, plan, tables
from icpshap.explanation.scan_pair import ScanPair
from icpshap.jobs import plans, played
from icpshap.tables import TableError

PAIRS = [(0, 1), (2, 3), (4, 5)]
ROWS = pd.DataFrame(
    [
        {
            "sequence": "drive",
            "reference": reference,
            "source": source,
            "characteristic_length": 1.0 + reference,
            **dict(zip(tables.TRANSFORM, np.eye(4).ravel(), strict=True)),
            "registered": True,
            "reason": "",
            "warning": "",
        }
        for reference, source in PAIRS
    ]
)
MADE = {"levels": {"initial_pose": [1.5]}, "measured": causes.shown(), "of": "a diagnosis"}
PLANNED = {**MADE, "instances": plans.digest(MADE)}
NAMES = ["initial_pose", *causes.shown()]


@pytest.fixture
def instances(tmp_path):
    """Nothing of the first pair; the second on the first, the third on itself, both of noise."""
    frame = pd.DataFrame(
        {
            **ROWS[tables.PAIR],
            "played_reference": [-1, 0, 4],
            "played_source": [-1, 1, 5],
            "initial_pose": [1.0, 1.5, 1.5],
            "sensor_noise": [0.0, 0.02, 0.04],
            "partial_overlap": 0.0,
            "under_constrained": [0.0, 0.0, 0.5],
            "reason": ["nothing stands out", "", ""],
        }
    )
    path = tmp_path / "instances.parquet"
    tables.write(path, frame, "instances", MADE, NAMES)
    return [path]


def parts(runs_per_job):
    levels = {"initial_pose": [1.5], **plan.unknown_levels(causes.shown())}
    jobs = plan.jobs(PAIRS, levels, 1, 100, runs_per_job)
    return [part for job in jobs for part in job]


def test_the_number_of_settings_is_known_before_any_diagnosis():
    assert sum(part.stop - part.start for part in parts(300)) == len(PAIRS) * (2**4 + 1)


@pytest.mark.parametrize("runs_per_job", [100, 300, 10_000])
def test_each_distinct_setting_is_run_once_however_jobs_are_cut(instances, runs_per_job):
    games = played.games(ROWS, PLANNED, instances)
    run = {pair: [] for pair in PAIRS}
    for part in parts(runs_per_job):
        run[part.pair] += games[part.pair].settings(part, 1)
    assert [len(run[pair]) for pair in PAIRS] == [0, 2**2 + 1, 2**3 + 1]
    for pair in PAIRS[1:]:
        assert len(set(run[pair])) == len(run[pair])
        assert set(run[pair]) == set(plan.settings(games[pair].levels, 1))


def test_what_is_known_of_a_game_is_of_the_pair_that_is_run(instances):
    games = played.games(ROWS, PLANNED, instances)
    rows = played.by_pair(ROWS)
    none, other, own = (played.scan_pair(games[pair], rows, PLANNED) for pair in PAIRS)
    assert (other.reference, other.source, other.played) == (2, 3, (0, 1))
    assert other.characteristic_length == 1.0
    assert (own.played, own.characteristic_length) == ((4, 5), 5.0)
    assert none.played == (-1, -1) and none.columns["played_reference"] == -1
    told = played.described(ROWS, games)
    assert list(told.registered) == [False, True, True] and told.reason[0] == "nothing stands out"
    run = played.as_run(pd.DataFrame([pair.columns for pair in (none, other, own)]), PLANNED)
    assert list(run.reference) == [-1, 0, 4]


def test_levels_of_the_plan_are_played_on_the_pair_itself():
    planned = {"levels": {"sensor_noise": [0.02, 0.05]}}
    rows = ROWS.assign(reason=["little overlap", "", ""], registered=[False, True, True])
    games = played.games(rows, planned, [])
    assert [game.run for game in games.values()] == [None, (2, 3), (4, 5)]
    assert games[2, 3].levels == planned["levels"]
    plain = ScanPair.of(next(ROWS.itertuples()))
    assert "played_reference" not in plain.columns
    assert played.scan_pair(games[0, 1], played.by_pair(rows), planned).columns == plain.columns


def test_instances_of_another_diagnosis_are_refused(instances):
    with pytest.raises(TableError, match="made by another plan"):
        played.games(ROWS, {**PLANNED, "instances": plans.digest({"of": "another"})}, instances)
