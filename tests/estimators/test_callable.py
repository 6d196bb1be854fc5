"""Registrations of the user's own: what they are given, what becomes of what they return."""

import logging
import sys
from dataclasses import replace
from textwrap import dedent

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import REPOSITORY
from project import Project, change

from icpshap import config as configuration
from icpshap import estimators, registrations, se3
from icpshap.errors import UserError
from icpshap.estimators import KINDS, Estimator
from icpshap.estimators.kind import GOOD_STATUS
from icpshap.estimators.perturb import Perturbation, Perturbing, Streams, groups
from icpshap.jobs import digests
from icpshap.jobs.plans import Plans
from icpshap.plan import Setting
from icpshap.presets import Preset
from icpshap.tables import INITIAL_XI, TRANSFORM, XI

DEVIATION = Perturbation().deviation
STREAMS = Streams(1, "room", 0, 1)
CLEAN = Setting.at({"sensor_noise": 0.0, "initial_pose": 0.1})
NOISY = Setting.at({"sensor_noise": 0.02, "initial_pose": 0.1})
SETTINGS = [Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0}), CLEAN, NOISY]


def estimator(register, runs=50, **values):
    found = Estimator.of("callable", {"register": register, "runs": runs, **values})
    return found.of_causes(["sensor_noise", "initial_pose"])


def runs_of(pair, register, settings=SETTINGS, **values):
    return estimators.estimate(pair, settings, estimator(register, **values), DEVIATION, STREAMS)[0]


def start_as_it_is(reference, source, T_initial):
    return T_initial


def good(runs):
    return runs["status"].isin(GOOD_STATUS)


# --- what it is given, and what is made of what it returns ----------------------------------------


def test_poses_are_those_that_the_function_returns(room_pair):
    """The truth with a known error, which depends on the start."""
    truth = room_pair.T_reference_source

    def register(reference, source, T_initial):
        return truth @ se3.exp(0.1 * se3.log(se3.inverse(truth) @ T_initial))

    runs = runs_of(room_pair, register)
    assert len(runs) == 3 * 50
    assert good(runs).all()
    np.testing.assert_allclose(runs[XI], 0.1 * runs[INITIAL_XI].to_numpy(), atol=1e-12)
    assert (runs["iterations"] == 0).all()
    assert runs[["rmse", "inlier_ratio"]].isna().all(axis=None)


def test_it_is_called_once_a_run_with_the_rows_and_the_start_of_the_chain(room_pair):
    seen = []

    def register(reference, source, T_initial):
        seen.append((reference, source, T_initial))
        return T_initial

    of_kind = estimator(register)
    runs_of(room_pair, register)
    expected = [
        (group.reference, start.source[rows], T_initial)
        for group in groups(room_pair, SETTINGS, of_kind, DEVIATION, STREAMS)
        for start in group.starts
        for rows, T_initial in zip(start.rows, start.T_initial, strict=True)
    ]
    assert len(seen) == len(expected) == 3 * 50
    for found, known in zip(seen, expected, strict=True):
        for array, other in zip(found, known, strict=True):
            np.testing.assert_array_equal(array, other)
            assert array.dtype == float and array.flags.c_contiguous and array.flags.owndata


def test_starts_and_rows_are_those_of_monte_carlo(room_pair):
    runs = runs_of(room_pair, start_as_it_is)
    of_chain = Estimator.of("monte_carlo", {"runs": 50, "subsampling_probability": 0.5})
    of_chain = of_chain.of_causes(["sensor_noise", "initial_pose"])
    chain, _ = estimators.estimate(room_pair, SETTINGS, of_chain, DEVIATION, STREAMS)
    pd.testing.assert_frame_equal(runs[INITIAL_XI], chain[INITIAL_XI])


def test_what_it_does_to_its_arguments_stays_with_it(room_pair):
    def careless(reference, source, T_initial):
        answer = T_initial.copy()
        for array in (reference, source, T_initial):
            array[:] = 7.0
        return answer

    before = room_pair.reference.copy(), room_pair.source.copy()
    runs = runs_of(room_pair, careless)
    pd.testing.assert_frame_equal(runs, runs_of(room_pair, start_as_it_is))
    np.testing.assert_array_equal(room_pair.reference, before[0])
    np.testing.assert_array_equal(room_pair.source, before[1])


def test_an_array_that_it_keeps_and_changes_is_no_answer_of_later(room_pair):
    kept = np.eye(4)

    def register(reference, source, T_initial):
        kept[:] = T_initial
        return kept

    runs = runs_of(room_pair, register)
    pd.testing.assert_frame_equal(runs, runs_of(room_pair, start_as_it_is))


@pytest.mark.parametrize("convert", [np.float32, np.ndarray.tolist, np.asfortranarray])
def test_what_numpy_reads_as_a_pose_is_one(room_pair, convert):
    truth = convert(room_pair.T_reference_source)
    runs = runs_of(room_pair, lambda *_: truth, [CLEAN])
    assert good(runs).all()
    expected = np.tile(room_pair.T_reference_source.reshape(-1), (50, 1))
    np.testing.assert_allclose(runs[TRANSFORM], expected, atol=1e-6)


def test_a_setting_is_the_same_in_any_company(room_pair):
    register = "icpshap.registrations:small_gicp"
    together = runs_of(room_pair, register, noise_draws=2)
    alone = runs_of(room_pair, register, SETTINGS[1:2], noise_draws=2)
    last = together.iloc[50:100].reset_index(drop=True)
    assert last.equals(alone.reset_index(drop=True))


# --- failures -------------------------------------------------------------------------------------


class NoArray:
    """What a library returns that keeps the pose in an attribute."""


def turned(T):
    return T * np.array([1, 1, -1, 1])


FAILURES = {
    "nothing": (lambda T: None, "returned a NoneType, expected an array (4, 4)"),
    "an object": (lambda T: NoArray(), "returned a NoArray, expected an array (4, 4)"),
    "a wrong shape": (lambda T: T[:3], "returned an array (3, 4), expected (4, 4)"),
    "a pair": (lambda T: (T, 0.1), "returned a tuple, expected an array (4, 4)"),
    "not finite": (lambda T: T * np.nan, "returned entries that are not finite"),
    "scaled": (lambda T: T * 1.1, "returned a matrix that is no rigid transformation"),
    "a reflection": (turned, "returned a matrix that is no rigid transformation"),
    "transposed": (lambda T: T.T, "returned a matrix that is no rigid transformation"),
    "an error": (lambda T: {}["T"], "raised KeyError: 'T'"),
    "an end": (lambda T: sys.exit("no more"), "raised SystemExit: no more"),
}


@pytest.mark.parametrize(("answer", "said"), FAILURES.values(), ids=list(FAILURES))
def test_a_run_without_a_pose_has_failed_and_says_why(room_pair, caplog, answer, said):
    """Every second run fails: the others are as they would be without it."""
    calls = []

    def register(reference, source, T_initial):
        calls.append(None)
        return T_initial if len(calls) % 2 else answer(T_initial)

    with caplog.at_level(logging.INFO):
        runs = runs_of(room_pair, register)
    failed = runs[~good(runs)]
    assert len(failed) == 75
    assert set(failed["status"]) == {said}
    # A failed run keeps its start.
    assert runs[TRANSFORM].equals(runs_of(room_pair, start_as_it_is)[TRANSFORM])
    assert f"register {said}" in caplog.text
    assert "50 of 100 runs failed" in caplog.text or "25 of 50 runs failed" in caplog.text


def test_the_log_has_the_traceback_of_the_first_error_of_each_kind(room_pair, caplog):
    def register(reference, source, T_initial):
        raise RuntimeError("diverged")

    with caplog.at_level(logging.INFO):
        runs_of(room_pair, register, [NOISY])
    assert caplog.text.count('raise RuntimeError("diverged")') == 1
    assert "50 of 50 runs failed" in caplog.text


def test_a_message_is_short_on_one_line_and_the_same_in_every_run(room_pair, caplog):
    caplog.set_level(logging.CRITICAL)  # the report of a test cannot hold the odd letter

    def register(reference, source, T_initial):
        raise ValueError(f"{object()}\n  of \udcff\n" + 500 * "x")

    (status,) = set(runs_of(room_pair, register, [NOISY])["status"])
    assert status.startswith(r"raised ValueError: <object object at 0x...> of \udcff xxx")
    assert len(status) < 220
    status.encode()


def test_it_is_an_error_if_every_run_of_the_clean_setting_fails(room_pair):
    def broken(reference, source, T_initial):
        raise RuntimeError("no licence")

    clean = Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0})
    with pytest.raises(UserError) as caught:
        runs_of(room_pair, broken, [clean, NOISY])
    message = str(caught.value)
    assert "broken: all 50 runs of the unperturbed pair failed" in message
    assert "the first raised RuntimeError: no licence.\nHint: " in message


def test_where_only_perturbed_settings_fail_they_are_counted(room_pair):
    """A registration that gives up on noise is an answer about noise."""

    def register(reference, source, T_initial):
        off_the_walls = np.abs(reference - [5.0, 4.0, 3.5]).min(axis=1).max()
        if off_the_walls > 1e-6:
            raise RuntimeError("too noisy")
        return T_initial

    runs = runs_of(room_pair, register)
    assert (~good(runs)).groupby(runs["sensor_noise"]).sum().to_dict() == {0.0: 0, 0.02: 50}


def test_an_interrupt_is_no_failed_run(room_pair):
    def register(reference, source, T_initial):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        runs_of(room_pair, register)


# --- the configuration ----------------------------------------------------------------------------

MINE = """
import small_gicp  # whose version counts

def register(reference, source, T_initial):
    return T_initial

def of_two(reference, source):
    return None

answer = 42
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A working directory with modules of the user's own."""
    files = {
        "my_icp": MINE,
        "raises": "import my_icp\n1 / 0\n",
        "incomplete": "import no_such_library\n",
        "leaves": "raise SystemExit('bye')\n",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in files:
        sys.modules.pop(name, None)


def errors_of(config, **block):
    config["estimators"]["mine"] = {"kind": "callable", **block}
    with pytest.raises(configuration.ConfigError) as caught:
        configuration.load(config)
    (line,) = [line for line in str(caught.value).splitlines() if "estimators.mine" in line]
    return line


def test_a_file_of_the_working_directory_is_found(config, mine):
    config["estimators"]["mine"] = {"kind": "callable", "register": "my_icp:register"}
    found = configuration.load(config).estimators["mine"].estimator
    assert found.kind.function().__module__ == "my_icp"
    assert Estimator.decided(found.decides()) == found


@pytest.mark.parametrize(
    ("register", "said"),
    [
        ("no_such:f", "there is no module no_such. Hint: put no_such.py into the working directo"),
        ("no.such:f", "there is no module no. Hint: put no.py into"),
        ("my_icp:registr", "has no function registr, did you mean register? Hint: "),
        ("my_icp:answer", "my_icp:answer is a int, expected a function. Hint: "),
        ("my_icp:of_two", "my_icp:of_two(reference, source) does not take three arguments. Hint"),
        ("raises:f", "importing raises raised ZeroDivisionError: division by zero. Hint: python"),
        ("incomplete:f", "importing incomplete raised ModuleNotFoundError: No module named 'no_s"),
        ("leaves:f", "importing leaves raised SystemExit: bye. Hint: "),
        ("my_icp", "'my_icp' does not match"),
        ("my_icp.register", "does not match"),
        ("my_icp:", "does not match"),
        (7, "7 is not of type 'string'"),
    ],
)
def test_a_function_that_cannot_be_called_is_named_before_anything_runs(
    config, mine, register, said
):
    line = errors_of(config, register=register)
    assert "estimators.mine.register: " in line
    assert said in line


def test_a_function_must_be_named(config):
    assert "estimators.mine: missing register, which the kind callable needs. Hint: " in errors_of(
        config
    )


def test_what_is_missing_may_come_from_another(config, mine):
    config["estimators"] |= {
        "mine": {"kind": "callable", "register": "my_icp:register"},
        "other": {"based_on": "mine", "runs": 200},
    }
    found = configuration.load(config).estimators["other"].options
    assert (found["register"], found["runs"]) == ("my_icp:register", 200)


def test_half_of_the_source_points_are_kept_unless_it_says_otherwise():
    preset = Preset.of("callable", register=start_as_it_is)
    assert preset.options["subsampling_probability"] == 0.5
    assert preset.options["subsampling_mask"] == "redrawn"
    assert preset.with_options(runs=200).options["subsampling_probability"] == 0.5
    other = Preset.of("callable", register=start_as_it_is, subsampling_probability=0.05)
    assert other.options["subsampling_probability"] == 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_defaults_of_a_kind_are_of_options_that_there_are(kind):
    replace(Perturbing(), **KINDS[kind].defaults)


# --- the code that decides ------------------------------------------------------------------------

RUN_ICP = REPOSITORY / "workflow" / "scripts" / "run_icp.py"


def digest(register, script=RUN_ICP):
    digests._digest.cache_clear()
    return digests.code_digest(script, estimator(register).plugins)


def test_the_file_of_the_function_decides_and_its_words_do_not(mine):
    before = digest("my_icp:register")
    change(mine / "my_icp.py", "answer = 42", "answer = 42  # why")
    assert digest("my_icp:register") == before
    change(mine / "my_icp.py", "return T_initial", "return T_initial + 0")
    assert digest("my_icp:register") != before


def test_the_version_of_what_it_imports_decides(mine, monkeypatch):
    before = digest("my_icp:register")
    found = digests.metadata.version
    monkeypatch.setattr(
        digests.metadata, "version", lambda name: "9" if name == "small_gicp" else found(name)
    )
    assert digest("my_icp:register") != before


@pytest.mark.parametrize("name", ["small_gicp", "open3d"])
def test_the_versions_of_both_libraries_decide_the_shipped_registrations(name):
    """Open3D is imported by a module of the library."""
    (module,) = estimator(f"icpshap.registrations:{name}").kind.modules
    assert name in digests._versions(module)


def test_a_compiled_module_has_a_digest_too():
    assert digest("small_gicp:align") != digest("math:fma")


def test_a_job_finds_the_same_code_as_the_plan(mine):
    of_kind = estimator("my_icp:register")
    names = digests.plugin_names(of_kind)
    assert names["modules"] == ["my_icp"]
    assert digests.code_digest(RUN_ICP, digests.plugins(names)) == digest("my_icp:register")


def test_only_the_experiments_that_use_it_are_planned_anew(config, mine):
    config["estimators"]["mine"] = {"kind": "callable", "register": "my_icp:register"}
    config["experiments"]["own"] = {"based_on": "different_perturbations", "estimator": "mine"}

    def planned():
        digests._digest.cache_clear()
        plans = Plans(
            configuration.load(config),
            {},
            lambda script, *plugins: digests.code_digest(RUN_ICP, plugins),
        )
        names = ("own", "different_perturbations")
        return [plans.job_digests(name, "apartment") for name in names]

    own, others = planned()
    change(mine / "my_icp.py", "return T_initial", "return T_initial + 0")
    own_after, others_after = planned()
    assert not set(own) & set(own_after)
    assert others == others_after


# --- other libraries, and the workflow ------------------------------------------------------------


def test_normals_of_open3d_are_kept_for_the_next_call_with_the_same_reference(room_pair):
    registrations._with_normals.cache_clear()
    there = room_pair.T_reference_source
    ends = [
        registrations.open3d(reference, room_pair.source, there)
        for reference in (room_pair.reference, room_pair.reference.copy())
    ]
    assert registrations._with_normals.cache_info().hits == 1
    registrations.open3d(room_pair.reference + 0.01, room_pair.source, there)
    assert registrations._with_normals.cache_info().misses == 2
    # Threads of Open3D, where there are several, sum in another order each time.
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["small_gicp", "open3d"])
def test_the_shipped_registrations_find_the_pose(room_pair, name):
    runs = runs_of(room_pair, f"icpshap.registrations:{name}", [CLEAN, NOISY])
    assert good(runs).all()
    error = runs[XI].to_numpy()
    success = np.linalg.norm(error[:, :3], axis=1) < np.deg2rad(2)
    success &= np.linalg.norm(error[:, 3:], axis=1) < 0.1
    assert success.mean() > 0.95
    # Half of the points, another half in each run.
    assert (runs.groupby("sensor_noise")[XI].std() > 1e-5).all(axis=None)


PLANE_ICP = dedent(
    """
    from icpshap.registrations import small_gicp

    def register(reference, source, T_initial):
        if len(source) % 20 == 0:
            raise RuntimeError("my library gave up")
        return small_gicp(reference, source, T_initial)
    """
)


@pytest.mark.slow
def test_the_workflow_runs_a_function_of_the_working_directory(tmp_path):
    project = Project(tmp_path)
    (tmp_path / "my_icp.py").write_text(PLANE_ICP)
    own = {
        "run": ["own"],
        "estimators": {"own": {"kind": "callable", "register": "my_icp:register", "runs": 60}},
        "experiments": {
            "own": {
                "estimator": "own",
                "pairs": [{"sequence": "tiny_room", "reference": 0, "source": 1}],
                "instances": {"fixed": {"sensor_noise": 0.05, "initial_pose": 1.5}},
                "figures": ["summary", "waterfall"],
            }
        },
    }
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(own))
    project.run("--configfile", "tiny.yaml", "own.yaml")
    (row,) = pd.read_parquet(tmp_path / "results/own/shap.parquet").itertuples()
    assert np.isfinite([row.f, row.phi_sensor_noise, row.phi_initial_pose]).all()
    assert 0 < row.n_failed < row.n_runs
    runs = pd.concat(map(pd.read_parquet, tmp_path.glob("results/own/tiny_room/runs/*.parquet")))
    assert set(runs["status"]) == {"ok", "raised RuntimeError: my library gave up"}
    logs = "".join(log.read_text() for log in tmp_path.glob("logs/run_icp/own/**/*.log"))
    assert "my_icp:register raised RuntimeError: my library gave up" in logs
    assert "runs that failed" in (tmp_path / "results/own/figures/summary.txt").read_text()

    change(tmp_path / "my_icp.py", "% 20 == 0", "% 20 == 1")
    said = project.run("-n", "--configfile", "tiny.yaml", "own.yaml")
    assert "run_icp" in said
    change(tmp_path / "my_icp.py", "def register(", "def registration(")
    said = project.run("-n", "--configfile", "tiny.yaml", "own.yaml", fails=True)
    assert "estimators.own.register: the module my_icp" in said
    assert "has no function register, did you mean registration?" in said
