"""One pair explained: what comes back holds together, and says what is wrong."""

import copy
import json
import pickle
import subprocess
import sys
import threading
import zipfile
from io import BytesIO, StringIO

import numpy as np
import pytest
from matplotlib import pyplot

import icpshap
from icpshap import se3
from icpshap.errors import DataError, UserError
from icpshap.export import export
from icpshap.export.measurement import read_covariances
from icpshap.one_pair import screen
from icpshap.one_pair.threads import in_threads
from icpshap.report import captions

LEAN = ("open3d", "shap", "matplotlib", "plotly", "snakemake")


def test_shapley_values_sum_to_f_and_lie_in_their_intervals(explained):
    table = explained.shapley
    assert list(table.index) == ["sensor_noise", "initial_pose", "partial_overlap"]
    assert table.value.sum() == pytest.approx(explained.f)
    assert (table.low <= table.value).all()
    assert (table.value <= table.high).all()
    assert set(explained.interactions.columns) == {"value", "low", "high"}
    assert len(explained.interactions) == 3


def test_the_covariance_is_that_of_the_runs(explained):
    runs = explained.tables["runs"]
    runs = runs[~runs.again & (runs.replicate == 0)]
    on = np.all([runs[name] == level for name, level in explained.levels.items()], axis=0)
    assert on.sum() == 60
    xi = runs[on][[f"xi_{k}" for k in range(6)]].to_numpy()
    assert np.asarray(explained.covariance) == pytest.approx(np.cov(xi.T), rel=1e-9)
    assert explained.covariance.share_of_points == 0.3
    whole = np.asarray(explained.covariance_all_points)
    assert whole == pytest.approx(0.3 * explained.covariance.matrix)
    clean = np.linalg.slogdet(explained.covariance_clean.matrix)[1]
    assert clean < np.linalg.slogdet(explained.covariance.matrix)[1]


def test_the_game_is_that_of_the_shapley_values(explained):
    game = explained.game
    assert len(game) == 8
    causes = list(explained.shapley.index)
    f = {tuple(row[causes]): row.f for _, row in game.iterrows()}
    assert f[True, True, True] == explained.f
    for k, name in enumerate(causes):
        without = tuple(other != k for other in range(3))
        assert explained.removal.value[name] == pytest.approx(explained.f - f[without])
    parts = explained.wrong_basin.value.sum()
    clean = explained.tables["shap"].clean_wrong_basin_share[0]
    assert parts == pytest.approx(explained.wrong_basin_share - clean)


def test_errors_are_in_centimetres_and_degrees(explained):
    row = explained.tables["shap"].iloc[0]
    assert explained.error_perturbed.centimetres == 100 * row.translation_rmse
    assert explained.error_clean.degrees == pytest.approx(np.rad2deg(row.clean_rotation_rmse))
    assert explained.error_clean.centimetres < explained.error_perturbed.centimetres


def test_the_weakest_direction_is_a_unit_vector_of_the_largest_variance(explained):
    weakest = explained.weakest_direction
    assert np.linalg.norm(weakest.vector) == pytest.approx(1)
    assert weakest.words
    turn = np.kron(np.eye(2), explained.T_reference_source[:3, :3])
    length = explained.tables["pairs"].characteristic_length[0]
    turn = np.diag(3 * [length] + 3 * [1.0]) @ turn
    variances = np.linalg.eigvalsh(turn @ explained.covariance.matrix @ turn.T)
    assert weakest.perturbed == pytest.approx(100 * np.sqrt(variances[-1]), rel=1e-4)


def test_it_begins_with_the_pose_error(explained):
    assert explained.sentence.startswith("Pose error (root mean square): clean ")
    assert "pair (" not in explained.sentence


def test_a_screen_has_at_most_40_lines(explained):
    for width in (60, 100):
        lines = explained.to_text(width).splitlines()
        assert len(lines) <= 40
        assert max(map(len, lines)) <= max(width, 80)
    assert explained.to_text(20) == explained.to_text(72)
    text = repr(explained)
    for part in ("Covariance [rad^2", "Weakest direction", "█", "What to do"):
        assert part in text
    assert "\033[" not in text
    assert "\033[1m" in explained.to_text(colours=True)


def test_what_breaks_the_answer_is_its_first_warning_and_said_once_on_the_screen(scans, options):
    reference, source, T = scans
    found = icpshap.explain(reference, source, se3.inverse(T), estimator=options)
    broken, truth, *_ = found.warnings
    assert broken.startswith("The settings do not fit the scans") and broken in found.sentence
    assert "nearer with the inverse motion" in broken
    assert truth.startswith("The true pose looks wrong. The ground truth looks wrong: with the inv")
    text = found.to_text()
    assert text.count("The settings do not fit the scans") == 1
    assert len(text.splitlines()) <= 40


def test_what_the_screen_has_no_room_for_ends_in_dots():
    assert screen._cut(["- one two", "  three"], 2) == ["- one two", "  three"]
    assert screen._cut(["- one two", "  three four", "  five"], 2) == ["- one two", "  three ..."]


def test_json_is_plain_and_complete(explained):
    found = json.loads(explained.to_json())
    assert found["shapley"]["sensor_noise"]["value"] == explained.shapley.value["sensor_noise"]
    assert found["covariance"]["order"] == "rotation first"
    assert found["options"]["runs"] == 60
    assert found["levels"] == {"sensor_noise": 0.02, "initial_pose": 1.5, "partial_overlap": 0.05}
    assert found["version"] == icpshap.__version__
    assert [row["what_if"] for row in found["what_if"]] == ["as it is", "more"]
    assert len(found["fit"]) == 12


def test_it_is_saved_and_loaded_whole(explained, tmp_path):
    explained.save(tmp_path / "pair.zip")
    loaded = icpshap.Explanation.load(tmp_path / "pair.zip")
    assert loaded.to_json() == explained.to_json()
    assert loaded.to_text() == explained.to_text()
    again = tmp_path / "again.zip"
    loaded.save(again)
    assert again.read_bytes() == (tmp_path / "pair.zip").read_bytes()
    with pytest.raises(UserError, match="explain the pair again to see its scene"):
        loaded.plot("scene")


def zipped(**parts):
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name.replace("_", "."), content)
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        None,
        b"",
        b"PK\x03\x04 cut off",
        zipped(a_txt=b"foreign"),
        zipped(about_json=b"[]"),
        zipped(about_json=b"{}"),
    ],
)
def test_a_file_that_is_no_explanation_is_refused(content, tmp_path):
    path = tmp_path / "pair.zip"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match=str(path)):
        icpshap.Explanation.load(path)


def test_a_file_of_another_version_that_has_other_parts_says_which(explained, tmp_path):
    path = tmp_path / "pair.zip"
    explained.save(path)
    with zipfile.ZipFile(path) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    about = {**json.loads(parts["about.json"]), "version": "0.9.9", "more": 1}
    with zipfile.ZipFile(path, "w") as file:
        for name, content in {**parts, "about.json": json.dumps(about)}.items():
            file.writestr(name, content)
    with pytest.raises(UserError, match=r"written by icpshap 0\.9\.9"):
        icpshap.Explanation.load(path)


def test_it_can_be_copied_and_pickled(explained):
    for copied in (copy.deepcopy(explained), pickle.loads(pickle.dumps(explained))):
        assert copied.to_json() == explained.to_json()


def test_a_place_that_cannot_be_written_is_named(explained, tmp_path):
    with pytest.raises(UserError, match="cannot be written"):
        explained.save(tmp_path / "nowhere" / "pair.zip")


def test_every_figure_and_the_page_are_drawn(explained):
    for name in ("waterfall", "interactions", "directions", "scene"):
        assert explained.plot(name).get_axes()
    with pytest.raises(UserError, match="expected one of waterfall"):
        explained.plot("pie")
    page = explained.to_html()
    assert page.count("<img ") == 4
    assert not pyplot.get_fignums()
    assert captions.found(
        explained.tables["shap"], explained.directions, explained.study
    ) in page.replace("&#39;", "'")
    assert "Run times" not in page
    assert "sensor noise" in explained._repr_html_()


def test_shap_gets_the_values_with_their_bounds(explained):
    found = explained.to_shap()
    assert found.values[0] == pytest.approx(explained.shapley.value)
    assert found.lower_bounds[0] == pytest.approx(explained.shapley.low)


def test_the_number_of_threads_changes_no_byte(scans, options, explained):
    for threads in (1, 3):
        found = icpshap.explain(
            *scans, estimator=options, what_if={"more": {"runs": 80}}, threads=threads
        )
        for name, table in explained.tables.items():
            assert found.tables[name].equals(table), name


def test_threads_return_in_order_and_stop_at_the_first_error():
    begun = []

    def half(number):
        begun.append(number)
        if number == 3:
            raise UserError("three")
        return number / 2

    done = []
    mapped = in_threads(2, lambda: done.append(1))
    assert list(mapped(half, [0, 1, 2])) == [0.0, 0.5, 1.0]
    assert len(done) == 3
    with pytest.raises(UserError, match="three"):
        list(mapped(half, iter(range(100))))
    assert max(begun) < 10


def test_without_a_pose_icp_answers_and_says_what_that_hides(scans, options):
    reference, source, T = scans
    found = icpshap.explain(reference, source, estimator=options)
    assert found.T_reference_source == pytest.approx(T, abs=0.02)
    assert "The true pose is what the registration itself answered" in " ".join(found.warnings)


def test_ones_own_registration_answers_for_the_truth_and_for_the_runs(scans, tmp_path):
    reference, source, T = scans
    calls, threads = [], []

    def own(reference, source, T_initial):
        calls.append(len(source))
        threads.append(threading.current_thread())
        return T_initial if len(calls) > 1 else T

    options = {"runs": 60, "noise_draws": 1, "sensor_sigma": 0.0, "bias_correction": "none"}
    found = icpshap.explain(
        reference, source, register=own, causes={"initial_pose": 2.0},
        estimator={**options, "based_on": "robust"},
    )  # fmt: skip
    assert len(calls) == 1 + 3 * 60
    assert set(threads) == {threading.current_thread()}  # so that Ctrl-C ends it where it is
    assert (found.T_reference_source == T).all()
    assert found.study.estimator == "own"
    found.save(tmp_path / "own.zip")
    assert icpshap.Explanation.load(tmp_path / "own.zip").to_json() == found.to_json()
    # What ends where it begins has the covariance of the start: twice that of the clean one.
    ratio = found.covariance.matrix / found.covariance_clean.matrix
    assert np.diagonal(ratio) == pytest.approx(2.0, rel=1e-6)


def test_a_registration_that_fails_is_named(scans):
    def broken(reference, source, T_initial):
        raise RuntimeError("no luck")

    with pytest.raises(DataError, match="RuntimeError: no luck"):
        icpshap.explain(*scans[:2], register=broken)


@pytest.mark.parametrize(
    ("returned", "message"),
    [(np.eye(4)[:3], r"returned an array \(3, 4\)"), (None, "returned a NoneType")],
)
def test_a_registration_that_never_answers_is_found_out_before_all_runs(scans, returned, message):
    calls = []

    def broken(reference, source, T_initial):
        calls.append(1)
        return returned

    with pytest.raises(DataError, match=message):
        icpshap.explain(*scans, register=broken)
    assert len(calls) == 3


def test_a_package_that_a_registration_lacks_is_named(scans):
    def lacking(reference, source, T_initial):
        import no_such_package  # noqa: F401

    with pytest.raises(UserError, match="pip install no_such_package"):
        icpshap.explain(*scans, register=lacking)


def test_a_failure_is_told_once(scans, caplog):
    def sometimes(reference, source, T_initial):
        if len(source) < len(scans[1]):
            raise RuntimeError("no luck")
        return T_initial

    with pytest.raises(UserError, match="all 60 runs"):
        icpshap.explain(*scans, register=sometimes, estimator={"runs": 60})
    assert [row.levelname for row in caplog.records].count("WARNING") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"T_initial": np.eye(4)}, "T_initial: given with T"),
        ({"threads": 0}, "threads: 0"),
        ({"seed": -1}, "seed: -1"),
        ({"indices": (0,)}, "indices: "),
        ({"progress": "log.txt"}, "progress: 'log.txt' cannot be printed to"),
        ({"source_times": np.arange(10.0)}, "source_times"),
        ({"progress": BytesIO()}, "progress: "),
    ],
)
def test_arguments_that_cannot_be_used_are_named(scans, options, arguments, message):
    with pytest.raises(UserError, match=message) as error:
        icpshap.explain(*scans, estimator=options, **arguments)
    assert "Hint: " in str(error.value)


@pytest.mark.parametrize("call", [icpshap.explain, icpshap.fit_table])
def test_scans_in_kilometres_are_an_error_that_names_them(scans, options, call):
    reference, source, T = scans
    with pytest.raises(DataError, match=r"reference: 0 of .* points are farther than 1"):
        call(reference / 1000, source / 1000, T, estimator=options)


def test_times_that_no_cause_reads_are_an_error(scans, options):
    moments = np.arange(len(scans[1]), dtype=float)
    with pytest.raises(UserError, match=r"motion_distortion, which alone reads them[\s\S]*Hint"):
        icpshap.explain(*scans, estimator=options, source_times=moments)


def test_progress_says_how_many_steps_there_are(scans, options):
    said = StringIO()
    levels = {"initial_pose": 1.5}
    few = {**options, "maximum_iterations": 5, "noise_draws": 3}
    icpshap.explain(*scans, causes=levels, estimator=few, progress=said)
    shown = [line.strip() for line in said.getvalue().split("\r") if line.strip()]
    assert shown[0] == "as it is (1 of 1)"
    steps = [line.partition(": ")[2] for line in shown[1:]]
    assert steps == [f"step {k} of {len(steps) - 1}" for k in range(len(steps))]
    assert len(steps) - 1 == 2 * 3  # the clean setting again has draws of its own


def test_the_fit_of_a_registration_has_no_normals_of_ours(scans):
    calls = []

    def register(reference, source, T_initial):
        calls.append(T_initial)
        return T_initial

    table = icpshap.fit_table(*scans, register=register)
    assert len(calls) == 1
    assert "true pose" in set(table.check) and "rings" not in set(table.check)


def test_a_pile_of_equal_points_is_judged():
    pile = np.full((1500, 3), 3.0)
    table = icpshap.fit_table(pile, pile, np.eye(4), estimator="paper")
    assert table.set_index("check").grade["duplicates"] != "fits"


@pytest.mark.parametrize("metric", ["point_to_plane", "point_to_point"])
def test_a_reference_of_too_few_points_is_an_error_with_a_hint(scans, options, metric):
    coarse = {**options, "voxel_size": 50.0, "metric": metric}
    with pytest.raises(
        UserError, match=r"points of the reference, expected at least .*\n.*voxel_si"
    ):
        icpshap.explain(*scans, estimator=coarse)


def test_a_warning_does_not_set_up_the_caller_s_logging(scans):
    code = (
        "import logging, numpy as np; from icpshap.data.pair import Pair, describe_pair;"
        "points = np.random.default_rng(0).uniform(2, 9, (1500, 3));"
        "pair = Pair.measured(points, points + 50, np.eye(4), 0.2);"
        "describe_pair(pair, 'a', (0, 1), levels=[], minimum_overlap=0.1, minimum_range=1.0);"
        "print(logging.getLogger().handlers)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert "overlap ratio" in done.stderr


def test_clean_runs_use_more_points_where_randomness_is_a_cause(scans, options):
    causes = {"icp_randomness": 2.0}
    found = icpshap.explain(*scans, causes=causes, estimator=options)
    assert found.covariance_clean.share_of_points == 0.3
    assert found.covariance.share_of_points == 0.15


def test_an_inverse_pose_is_red_and_stands_first(scans, options):
    reference, source, T = scans
    table = icpshap.fit_table(reference, source, se3.inverse(T), estimator=options)
    assert table.grade.iloc[0] == "red"
    assert table.check.iloc[0] == "true pose"


def test_scans_that_hardly_overlap_are_an_error_with_a_hint(scans):
    reference, source, T = scans
    far = T.copy()
    far[:3, 3] += 500.0
    with pytest.raises(DataError, match=r"is not above 0\.1"):
        icpshap.explain(reference, source, far)


def test_the_door_imports_nothing_heavy():
    code = (
        "import sys, icpshap.export, numpy as np; from icpshap.one_pair import recipe, screen; "
        f"print([name for name in {LEAN} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_what_was_saved_can_be_exported_with_the_same_numbers(explained, tmp_path):
    path = tmp_path / "pair.zip"
    explained.save(path)
    texts, remarks = export(read_covariances(path), "json", {})
    (found,) = json.loads(texts[""])["measurements"]
    assert remarks == []
    assert np.array(found["covariance"]).tobytes() == explained.covariance.matrix.tobytes()
    assert found["levels"] == explained.levels
