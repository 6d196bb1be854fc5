"""The function and the command of one pair: hostile arguments, registrations, files, places.

What is given in another form must give the same numbers; what cannot be used must be refused by the
name of the argument or of the file.
"""

import io
import math
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

import icpshap
from benchmarks.faults.outcome import Fault, Outcome, of_call, said_of
from benchmarks.faults.values import NUMBERS, OTHERS
from icpshap import cli, se3
from icpshap.causes import CAUSES
from icpshap.estimators import KINDS

POINTS = 1500  # of a scan
ROOM = np.array([6.0, 4.0, 3.0])  # m
T = se3.exp(np.array([0.0, 0.0, 0.1, 0.3, 0.1, 0.0]))
ESTIMATOR = {"based_on": "lidar", "runs": 60, "noise_draws": 1, "sensor_noise_by": "closed_form"}
GIVEN = {"causes": {"sensor_noise": 0.02, "initial_pose": 1.5}, "estimator": ESTIMATOR}
SUFFIXES = (".npy", ".csv", ".xyz", ".ply", ".pcd", ".bin", ".laz", ".e57", ".parquet", ".txt.gz")


def scans():
    """Reference and source (n, 3) [m] of a room, each in its scanner's frame; T is between them."""
    generator = np.random.default_rng(7)

    def walls():
        points = (generator.random((POINTS, 3)) - 0.5) * ROOM
        axis = generator.integers(3, size=POINTS)
        places = np.arange(POINTS)
        points[places, axis] = np.sign(points[places, axis]) * ROOM[axis] / 2
        return points + generator.normal(0.0, 0.005, points.shape)

    return walls(), se3.transform(se3.inverse(T), walls())


def faults(folder, seed, number, short):
    """number: of options of estimators that are given something of another type or size."""
    generator = np.random.default_rng(seed)
    reference, source = scans()
    yield from _other_forms(reference, source)
    yield from _arguments(reference, source)
    yield from _options(reference, source, generator, number)
    yield from _registrations(reference, source)
    yield from _files(Path(folder), reference, source, generator, 1 if short else 5)


# --- the function ---------------------------------------------------------------------------------


def _other_forms(reference, source):
    """The same numbers in another array."""
    read_only = source.copy()
    read_only.setflags(write=False)
    forms = {
        "in Fortran's order": np.asfortranarray(source),
        "every second row of a larger one": np.repeat(source, 2, axis=0)[::2],
        "read-only": read_only,
        "of the other byte order": source.astype(source.dtype.newbyteorder()),
        "as lists": source.tolist(),
        "as a data frame": pd.DataFrame(source, columns=list("xyz")),
        "with more columns": np.column_stack([source, np.arange(len(source))])[:, :3],
        "as a matrix": np.matrix(source),
        "masked, nothing of it": np.ma.array(source, mask=False),
    }
    for words, form in forms.items():
        yield Fault(f"source {words}", partial(_same, reference, source, form))
    for threads in (2, 7):
        yield Fault(f"threads: {threads}", partial(_same, reference, source, source, threads))


def _same(reference, source, form, threads=1):
    expected = icpshap.explain(reference, source, T, **GIVEN, threads=1).to_json()
    return of_call(
        lambda: icpshap.explain(reference, form, T, **GIVEN, threads=threads).to_json(),
        lambda found: found == expected,
        "source",
    )


def _arguments(reference, source):
    """One argument at a time that nobody should give."""
    whole = {"reference": reference, "source": source, "T": T, **GIVEN}
    cases = [(name, value) for name in ("reference", "source") for value in _clouds(source)]
    cases += [("T", value) for value in _transforms()]
    cases += [("causes", {name: value}) for name in CAUSES for value in (*NUMBERS, *OTHERS)]
    cases += [("causes", value) for value in OTHERS if value is not None]
    cases += [("causes", dict.fromkeys(CAUSES, 0.5) | {f"other_{k}": 1.0 for k in range(9)})]
    cases += [("estimator", value) for value in (*OTHERS, "lidars", {"based_on": "lidars"})]
    for name in ("seed", "threads", "indices", "name", "what_if", "perturbation", "source_times"):
        cases += [(name, value) for value in OTHERS]
    cases += [("perturbation", {"overlap_distance": value}) for value in NUMBERS]
    cases += [("what_if", {"closer": {"initial_pose": value}}) for value in NUMBERS]
    cases += [("what_if", {"more": {"runs": value}}) for value in (1, 10**9, "many")]
    cases += [("register", value) for value in (1, "no", "no:no", "os:nothing", "os:getcwd", [])]
    for name, value in cases:
        given = {**whole, name: value}
        words = f"{name}: {_shown(value)}"
        yield Fault(words, partial(_explained, given, _names(name, value)))


def _shown(value):
    if isinstance(value, np.ndarray):
        return f"an array {value.shape} of {value.dtype}, the first {value.flat[:3]}"
    return f"{value!r:.80}"


def _names(name, value):
    """What an error may call an argument: a key that it holds, or what is named within."""
    names = [name, "icpshap.explain", "the pair", "the scans"]
    return names + [str(key) for key in value] if isinstance(value, dict) else names


def _explained(given, names):
    given = dict(given)
    scans_ = given.pop("reference"), given.pop("source"), given.pop("T")
    if "register" in given:
        given["estimator"] = {"based_on": "lidar", "runs": 60}
    return of_call(lambda: icpshap.explain(*scans_, **given), _is_whole, *names)


def _is_whole(explanation):
    """Whether an explanation is one that a person can read, and says what it does not know."""
    text, told = explanation.to_text(), explanation.to_dict()
    known = math.isfinite(explanation.f) or bool(explanation.warnings)
    return bool(text) and bool(told["sentence"]) and known


def _clouds(source):
    changed = {
        "nan": (3, np.nan),
        "inf": (5, np.inf),
        "huge": (7, 1e300),
        "far": (9, 1e9),
    }
    for row, value in changed.values():
        cloud = source.copy()
        cloud[row, 1] = value
        yield cloud
    yield from (None, 1.0, "scan.pcd", {}, [], [[]], source[0], source[:, :2], source[:999])
    yield np.column_stack([source, source])
    yield source[None]
    yield source.astype(object)
    yield source.astype(str)
    yield source.astype(complex)
    yield source > 0
    yield np.zeros_like(source)
    yield np.ones_like(source)
    yield source * [1.0, 0.0, 0.0]
    yield source * [1.0, 1.0, 0.0]
    yield np.repeat(source[:10], 150, axis=0)
    yield 1000.0 * source
    yield 0.001 * source
    yield source * 1e-300
    yield source * 1e300
    yield np.full_like(source, np.nan)
    yield np.ma.array(source, mask=source > 1.0)


def _transforms():
    reflected = T @ np.diag([1.0, 1.0, -1.0, 1.0])
    scaled = T @ np.diag([1.1, 1.1, 1.1, 1.0])
    yield from (reflected, scaled, T.T, T[:3, :3], T * np.nan, T * np.inf, np.zeros((4, 4)))
    yield from ("T.txt", 1.0, [], [1.0] * 16, [1.0] * 15, [0.0] * 7, {"T": 1}, T.astype(object))
    yield T + 0.01
    yield se3.exp(np.array([0.0, 0.0, 0.0, 500.0, 0.0, 0.0]))
    yield se3.exp(np.array([0.0, 0.0, 0.0, 1e300, 0.0, 0.0]))


# --- estimators -----------------------------------------------------------------------------------


def _options(reference, source, generator, number):
    """Options of every kind, each set to something else; the fit table reads and checks them."""
    kinds = list(KINDS)
    for _ in range(number):
        kind = kinds[generator.integers(len(kinds))]
        options = list(KINDS[kind].__dataclass_fields__)
        option = options[generator.integers(len(options))]
        values = (*NUMBERS, *OTHERS)
        value = values[generator.integers(len(values))]
        estimator = {"kind": kind, option: value}
        yield Fault(
            f"estimator {kind}, {option}: {value!r}",
            partial(_fitted, reference, source, estimator, [option, kind, "estimator"]),
        )


def _fitted(reference, source, estimator, names):
    def fitted():
        return icpshap.fit_table(reference, source, T, estimator=estimator)

    return of_call(fitted, lambda table: len(table) > 0, *names)


# --- another's registration -----------------------------------------------------------------------


def towards(reference, source, T_initial):
    """A registration that always goes nine tenths of the way."""
    return T @ se3.exp(0.1 * se3.log(se3.inverse(T) @ T_initial))


def _registrations(reference, source):
    def writing(reference, source, T_initial):
        found = towards(reference, source, T_initial)
        reference[:], source[:], T_initial[:] = 0.0, np.nan, 7.0
        return found

    def growing(reference, source, T_initial, found=[]):  # noqa: B006 it remembers, on purpose
        found.append(towards(reference, source, T_initial))
        return found[-1]

    same = {
        "writes into its arguments": writing,
        "remembers all that it answered": growing,
        "answers lists": lambda *given: towards(*given).tolist(),
        "answers in Fortran's order": lambda *given: np.asfortranarray(towards(*given)),
    }
    for words, function in same.items():
        yield Fault(
            f"a registration that {words}", partial(_as_another, reference, source, function)
        )

    def leaving(*given):
        raise SystemExit(3)

    def failing(*given):
        raise RuntimeError("out of luck\n" * 100_000)

    refused = {
        "answers None": lambda *given: None,
        "answers nan": lambda *given: np.full((4, 4), np.nan),
        "answers a rotation": lambda *given: T[:3, :3],
        "answers a reflection": lambda *given: np.diag([1.0, 1.0, -1.0, 1.0]),
        "answers words": lambda *given: "converged",
        "answers itself": lambda *given: given,
        "answers huge numbers": lambda *given: np.full((4, 4), 1e308),
        "raises a long message": failing,
        "raises itself forever": lambda *given: refused["raises itself forever"](*given),
        "ends the process": leaving,
        "takes two arguments": lambda reference, source: T,
        "has no module": np.sin,
    }
    for words, function in refused.items():
        given = {"reference": reference, "source": source, "T": T, "causes": GIVEN["causes"]}
        names = ["register", getattr(function, "__name__", "register")]
        yield Fault(
            f"a registration that {words}",
            partial(_explained, {**given, "register": function}, names),
        )
    yield Fault(
        "a registration that fails every third time", partial(_some_fail, reference, source)
    )


def _as_another(reference, source, function):
    given = {"causes": GIVEN["causes"], "estimator": {"based_on": "lidar", "runs": 60}}
    expected = icpshap.explain(reference, source, T, register=towards, **given)

    def is_right(found):
        return found.f == expected.f and found.shapley.equals(expected.shapley)

    return of_call(
        lambda: icpshap.explain(reference, source, T, register=function, **given),
        is_right,
        "register",
    )


def _some_fail(reference, source):
    calls = iter(range(10**9))

    def failing(*given):
        if next(calls) % 3 == 2:
            raise ValueError("no luck")
        return towards(*given)

    given = {"causes": GIVEN["causes"], "estimator": {"based_on": "lidar", "runs": 60}}

    def is_right(found):
        failed = found.tables["uncertainty"].n_failed
        return (failed > 0).all() and any("fail" in said for said in found.warnings)

    return of_call(
        lambda: icpshap.explain(reference, source, T, register=failing, **given),
        is_right,
        "register",
    )


# --- the command ----------------------------------------------------------------------------------


def _files(folder, reference, source, generator, each):
    """Scan files that are damaged or none, a damaged explanation, places that cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "reference.npy", reference)
    np.save(folder / "source.npy", source)
    np.savetxt(folder / "T.txt", T)
    explanation = icpshap.explain(reference, source, T, **GIVEN)
    explanation.save(folder / "pair.zip")
    whole = (folder / "pair.zip").read_bytes()
    expected = explanation.to_json()
    for words, damaged in _cut(whole, generator, 8 * each):
        yield Fault(f"pair.zip: {words}", partial(_loaded, folder, damaged, expected))
    contents = {
        "nothing": b"",
        "garbage": generator.bytes(4000),
        "a text": b"no points here\n" * 300,
        "a table without names": b"1 2\n" * 2000,
        "zeros": bytes(48_000),
        "one long line": b"1 " * 30_000,
        "a page": b"<html><body>404</body></html>",
    }
    for suffix in SUFFIXES:
        for words, content in contents.items():
            name = f"scan{suffix}"
            yield Fault(f"{name} holds {words}", partial(_fit, folder, name, content))
    whole = (folder / "source.npy").read_bytes()
    for words, damaged in _cut(whole, generator, 2 * each):
        yield Fault(f"scan.npy: {words}", partial(_fit, folder, "scan.npy", damaged))
    (folder / "taken").mkdir(exist_ok=True)
    for option, place in [
        *[("--html", place) for place in ("taken", "no/page.html", "", "n" * 300)],
        *[("--covariance", place) for place in ("taken", "no/c.txt", "/proc/none", "source.npy")],
        *[("--save", place) for place in ("taken", "no/pair.zip", "reference.npy")],
        *[("--transform", name) for name in ("taken", "no.txt", "source.npy", "pair.zip", "1e999")],
        *[("--register", name) for name in ("taken", "no:no", "json:loads", "../x:y", ":", "a:")],
        *[("--option", text) for text in ("runs", "=", "runs=", "=1", "runs=1e400", "no=1")],
        *[("--columns", text) for text in ("", "x", "x,y", "x,x,y,z", ",,,", "x,y,z,x")],
        *[("--what-if", text) for text in (":", "a:", "a:b", "a:runs=x", "x" * 5000)],
    ]:
        yield Fault(f"explain {option} {place!r:.60}", partial(_command, folder, option, place))


def _cut(whole, generator, number):
    """What is cut off, and what is another file."""
    for _ in range(number):
        cut = int(generator.integers(1, len(whole)))
        yield f"cut off at byte {cut} of {len(whole)}", whole[:cut]
    yield "zero-length", b""
    yield "garbage", generator.bytes(len(whole))


def _loaded(folder, damaged, expected):
    path = folder / "damaged.zip"
    path.write_bytes(damaged)
    return of_call(
        lambda: icpshap.Explanation.load(path).to_json(),
        lambda found: found == expected,
        path.name,
    )


def _fit(folder, name, content):
    (folder / name).write_bytes(content)
    source = ["source.npy", "--transform", "T.txt"]
    return _told(folder, ["fit", name, *source], name, "reference: ")


def _command(folder, option, place):
    arguments = ["explain", "reference.npy", "source.npy", "--quiet", "--option", "runs=60"]
    if option != "--transform":
        arguments += ["--transform", "T.txt"]
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    names = [option.strip("-"), option.strip("-").replace("-", "_"), place or "''"]
    names += ["T: "] if option == "--transform" else []
    found = _told(folder, [*arguments, option, place], *names)
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.name in before}
    return found if after == before else Outcome("wrong", "a file of the user is another one now")


def _told(folder, arguments, *names):
    """The command in a folder: told where it ends with 1 or 2 and says any of the names."""
    from benchmarks.faults.in_process import inside

    said = io.StringIO()
    try:
        with inside(folder), redirect_stdout(io.StringIO()), redirect_stderr(said):
            status = cli.main(arguments)
    except SystemExit as end:
        status = end.code
    except Exception as error:  # whatever else comes would reach the user as a traceback
        return Outcome("crash", f"{type(error).__name__}: {error}"[:400])
    if status == 0:
        return Outcome("wrong", "done without a word")
    return said_of(said.getvalue(), *names)
