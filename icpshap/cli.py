"""The command icpshap: explain or diagnose one pair, say whether options fit, export, bundle.

Exit status: 0 done, 1 data or options that cannot be used, 2 a wrong command line, 130 stopped.
"""

import argparse
import gc
import os
import shutil
import sys
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from icpshap import __version__
from icpshap.errors import UserError

DATA_ERROR, STOPPED = 1, 130
EXPLAIN_EXAMPLES = """\
examples:
  icpshap explain reference.pcd source.pcd --transform T.txt
  icpshap explain 000000.bin 000001.bin                      no pose: ICP's answer is the truth
  icpshap explain a.ply b.ply --transform 0.5 0 0 0 0 0 1    tx ty tz qx qy qz qw
  icpshap explain a.ply b.ply --register small_gicp          another registration than ours
  icpshap explain a.ply b.ply --what-if                      which change would help
  icpshap explain a.ply b.ply --sensor-noise 0.05 --partial-overlap 0    another level, one off
  icpshap explain a.ply b.ply --json > pair.json
  icpshap explain a.ply b.ply --html pair.html --covariance covariance.txt
"""
DIAGNOSE_EXAMPLES = """\
examples:
  icpshap diagnose a.ply b.ply --healthy c.ply d.ply --healthy d.ply e.ply
  icpshap diagnose a.ply b.ply --transform T.txt --healthy c.ply d.ply T_cd.txt
  icpshap diagnose a.ply b.ply --transform T.txt --sensor velodyne_vlp_16
  icpshap diagnose a.ply b.ply --transform T.txt --clean-runs    how often ICP ends elsewhere
  icpshap diagnose a.ply b.ply --json > diagnosis.json
"""
FIT_EXAMPLES = """\
examples:
  icpshap fit reference.pcd source.pcd --transform T.txt
  icpshap fit a.ply b.ply --estimator paper
"""
EXPORT_EXAMPLES = """\
examples:
  icpshap export results/drive/drive/covariances.parquet --to g2o --output drive.g2o
  icpshap export covariances.parquet --to tum --output drive.tum     and drive_covariances.tum
  icpshap export covariances.parquet --to gtsam --clean > drive.g2o  without any perturbation
  icpshap export covariances.parquet --to markdown                   a noise model to paste
  icpshap export pair.zip --to ros                                   what explain --save wrote
"""
BUNDLE_EXAMPLES = """\
examples:
  icpshap bundle a.ply b.ply --transform T.txt --output bundle.zip
  icpshap bundle a.ply b.ply --option normal_neighbours=30 --sensor-noise 0.05 --output bundle.zip
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # A terminal or a file may not know every letter.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        given = _parser().parse_args(_joined(arguments))
        given.run(given)
        if sys.stdout is not None:
            sys.stdout.flush()
    except UserError as error:
        print(f"icpshap: {error}", file=sys.stderr)
        return DATA_ERROR
    except KeyboardInterrupt:
        print("\nicpshap: stopped", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:
        _say_no_more()  # who read it has seen enough
    except OSError as error:  # those of files are UserErrors
        print(f"icpshap: the output cannot be written: {error.strerror}", file=sys.stderr)
        _say_no_more()
        return DATA_ERROR
    return 0


def run() -> None:
    """The command as a process of its own: ends it with the exit status."""
    status = main()
    if status == STOPPED:
        # Python would wait for the threads, which are in the middle of what nobody wants.
        os._exit(status)
    sys.exit(status)


def _say_no_more():
    """Let nothing be written at the end of the process that could not be written before."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


# --- explain --------------------------------------------------------------------------------------


def _explain(given: argparse.Namespace) -> None:
    from icpshap.one_pair.explanation import writable
    from icpshap.one_pair.recipe import explain

    # What is imported by now stays. To look through it for garbage once more at the end took a
    # tenth of an explanation; a user's module comes later, and what it has open is closed as ever.
    gc.freeze()
    _remarks(given.quiet)
    _require_places(given)
    reference, source = _scans(given)
    explanation = explain(
        reference,
        source,
        _transform(given.transform),
        causes=_causes(given),
        estimator=_estimator(given),
        register=_register(given.register),
        T_initial=_transform(given.initial_transform),
        what_if=_what_if(given.what_if),
        perturbation=_options(given.perturbation, "--perturbation"),
        seed=given.seed,
        threads=given.threads,
        progress=not given.quiet and _is_terminal(sys.stderr),
    )
    if given.html:
        with writable(given.html):
            Path(given.html).write_text(explanation.to_html(), encoding="utf-8")
    if given.covariance:
        import numpy as np

        found = explanation.covariance.to(given.covariance_convention)
        with writable(given.covariance):
            np.savetxt(given.covariance, found.matrix, header=found.in_words(), encoding="utf-8")
    if given.save:
        explanation.save(given.save)
    if given.json:
        if hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(encoding="utf-8")  # that of JSON, whatever the terminal's
        print(explanation.to_json(), end="")
    elif not given.quiet:
        width = min(shutil.get_terminal_size((100, 40)).columns, 100)
        print(explanation.to_text(width, _colours()))


def _diagnose(given: argparse.Namespace) -> None:
    from icpshap.one_pair.diagnosis import diagnose

    _remarks()
    reference, source = _scans(given)
    found = diagnose(
        reference,
        source,
        _transform(given.transform),
        healthy=[_healthy(words, given) for words in given.healthy],
        sensor=given.sensor,
        clean_runs=given.clean_runs,
        estimator=_estimator(given),
        T_initial=_transform(given.initial_transform),
        seed=given.seed,
    )
    if given.json:
        if hasattr(sys.stdout, "reconfigure"):
            sys.stdout.reconfigure(encoding="utf-8")  # that of JSON, whatever the terminal's
        print(found.to_json(), end="")
    else:
        print(found.to_text(min(shutil.get_terminal_size((100, 40)).columns, 100)))


def _fit(given: argparse.Namespace) -> None:
    from icpshap.fit import checks
    from icpshap.one_pair.recipe import fit_table

    _remarks()
    reference, source = _scans(given)
    found = fit_table(
        reference,
        source,
        _transform(given.transform),
        causes=_causes(given),
        estimator=_estimator(given),
        register=_register(given.register),
        T_initial=_transform(given.initial_transform),
        perturbation=_options(given.perturbation, "--perturbation"),
    )
    for row in found.itertuples():
        print(f"{row.grade:<7} {row.check:<17} {checks.said(row)}")


def _export(given: argparse.Namespace) -> None:
    from icpshap.export import clean, export
    from icpshap.export.measurement import read_covariances
    from icpshap.one_pair.explanation import writable

    _require_place("--output", given.output, [given.covariances])
    levels = {**(clean() if given.clean else {}), **_levels(given)}
    table = read_covariances(given.covariances)
    texts, remarks = export(table, given.to, levels, given.sequence)
    for remark in remarks:
        print(f"icpshap: {remark}", file=sys.stderr)
    if given.output is None:
        if len(texts) > 1:
            raise UserError(
                f"--to {given.to}: makes {len(texts)} files, expected --output.\n"
                f"Hint: --output drive.{given.to}"
            )
        print(texts[""], end="")
        return
    place = Path(given.output)
    for mark, text in texts.items():
        path = place.with_name(f"{place.stem}{mark}{place.suffix}")
        with writable(path):
            path.write_text(text, encoding="utf-8", newline="\n")


def _bundle(given: argparse.Namespace) -> None:
    from icpshap.one_pair import bundle
    from icpshap.one_pair.given import transform

    _require_place("--output", given.output, [given.reference, given.source])
    transforms = {
        option: transform(_transform(words), option)
        for option, words in (
            ("transform", given.transform),
            ("initial-transform", given.initial_transform),
        )
        if words is not None
    }
    words = ["--estimator", given.estimator]
    for option in ("option", "perturbation"):
        for text in getattr(given, option):
            words += [f"--{option}", text]
    if given.register:
        words += ["--register", given.register]
    for name, level in _levels(given).items():
        words += [f"--{name.replace('_', '-')}", repr(level)]
    reference, source = _scans(given)
    bundle.write(given.output, reference, source, transforms, words)
    print(f"{given.output}: points of both scans, pose, options and versions; nothing else.")


# --- what was typed -------------------------------------------------------------------------------


def _scans(given):
    return _read((given.reference, given.source), given)


def _read(paths, given):
    from icpshap.one_pair.given import read_scan

    columns = None if given.columns is None else given.columns.split(",")
    return [read_scan(path, columns, given.drop_non_finite) for path in paths]


def _healthy(words, given):
    """Reference, source and, where it is named, T of what `--healthy` names."""
    if len(words) not in (2, 3):
        raise UserError(
            f"--healthy {' '.join(words)}: expected two scans, or two scans and their transform.\n"
            "Hint: the two scans that are diagnosed stand before the first --healthy."
        )
    return [*_read(words[:2], given), *map(_transform, words[2:])]


def _transform(words: str | None) -> Any:
    """What `--transform` names: numbers, or a file of them; None of none."""
    if words is None:
        return None
    numbers = _numbers(words.split())
    if numbers is not None:
        return numbers
    from icpshap.data.poses import read_transforms

    transforms = read_transforms(words)
    if len(transforms) != 1:
        raise UserError(
            f"{words}: {len(transforms)} transforms, expected one, T_reference_source.\n"
            "Hint: keep the one of these two scans."
        )
    return transforms[0]


def _numbers(words):
    try:
        return [float(word) for word in words]
    except ValueError:
        return None


def _causes(given):
    """Levels of the default causes, changed by the command line; those that are off are none."""
    from icpshap.causes import CAUSES
    from icpshap.one_pair.given import CAUSES_GIVEN

    levels = {**CAUSES_GIVEN, **_levels(given)}
    # What is off is no cause; where all are, the check of the causes says so.
    return {name: level for name, level in levels.items() if level != CAUSES[name].off} or levels


def _levels(given):
    """The levels that were typed, by cause."""
    from icpshap.causes import CAUSES

    return {name: getattr(given, name) for name in CAUSES if getattr(given, name) is not None}


def _estimator(given):
    options = _options(given.option, "--option")
    return {"based_on": given.estimator, **options} if options else given.estimator


def _options(texts, where):
    """Values by key of texts KEY=VALUE."""
    options: dict[str, object] = {}
    for text in texts:
        key, sign, value = map(str.strip, text.partition("="))
        if not sign:
            raise UserError(
                f"{where} {text}: expected KEY=VALUE.\nHint: such as normal_neighbours=30."
            )
        _once(options, key, where)
        options[key] = value
    return options


def _once(known, key, where):
    """Raise UserError for a key that is there already: one of two values would be lost."""
    if key in known:
        raise UserError(f"{where} {key}: given twice.\nHint: leave one of them out.")


def _register(name):
    """A registration of icpshap.registrations by its name, or module:function."""
    return f"icpshap.registrations:{name}" if name and ":" not in name else name


def _what_if(texts):
    """True for the changes that are usual, else those named, NAME:KEY=VALUE,KEY=VALUE."""
    if texts is None:
        return False
    if not texts:
        return True
    changes: dict[str, dict[str, object]] = {}
    for text in texts:
        name, sign, listed = text.partition(":")
        if not sign:
            listed = name
            name = listed
        _once(changes, name, "--what-if")
        changes[name] = _options(listed.split(","), "--what-if")
    return changes


def _require_places(given):
    """Raise UserError where a file could not be written, before anything is computed."""
    taken = [given.reference, given.source]
    for option in ("html", "covariance", "save"):
        path = getattr(given, option)
        _require_place(f"--{option}", path, taken)
        taken += [path] if path else []
    if given.html:
        from icpshap.one_pair.pictures import modules_of_the_page

        modules_of_the_page()


def _require_place(option, path, taken):
    """Raise UserError where a file could not be written, or would be in the place of one taken."""
    if path is None:
        return
    place = Path(path).absolute()
    if not path or not _is_writable(place):
        raise UserError(
            f"{option} {path}: cannot be written, expected a file in a folder that is there and "
            "that you may write to.\nHint: make the folder, or give another place."
        )
    if place.resolve() in [Path(other).resolve() for other in taken]:
        raise UserError(
            f"{option} {path}: would overwrite another file of this command.\n"
            "Hint: give another place."
        )


def _is_writable(place):
    """Whether a file can be written, or made where there is none."""
    try:
        there = place.exists()
        return not place.is_dir() and os.access(place if there else place.parent, os.W_OK)
    except OSError:  # such as a name that is too long
        return False


def _is_terminal(stream):
    return stream is not None and stream.isatty()


def _colours():
    known = "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb"
    return known and _is_terminal(sys.stdout)


def _remarks(quiet: bool = False) -> None:
    """What the library remarks goes to standard error: that it compiles, which takes a while, too.

    quiet: nothing but errors.
    """
    import logging

    logging.basicConfig(format="%(message)s", level=logging.WARNING, stream=sys.stderr)
    for name, level in (("icpshap", logging.NOTSET), ("icpshap.icp.compiled", logging.INFO)):
        logging.getLogger(name).setLevel(logging.ERROR if quiet else level)


def _joined(arguments: list[str]) -> list[str]:
    """Numbers of a transform as one word: argparse takes some that are negative for options."""
    result: list[str] = []
    place = 0
    while place < len(arguments):
        word = arguments[place]
        result.append(word)
        place += 1
        if word == "--healthy":  # two scans, and a transform that needs no option
            result += arguments[place : place + 2]
            place += 2
        if word in ("--transform", "--initial-transform", "--healthy"):
            numbers = list(takewhile(lambda word: _numbers([word]) is not None, arguments[place:]))
            place += len(numbers)
            if numbers and word == "--healthy":
                result.append(" ".join(numbers))
            elif numbers:
                result[-1] += "=" + " ".join(numbers)
    return result


def _parser() -> argparse.ArgumentParser:
    from icpshap.one_pair.given import SEED

    parser = argparse.ArgumentParser(
        prog="icpshap",
        description="Why is the registration of two scans uncertain?",
        epilog="Each command has examples: icpshap explain --help.",
    )
    parser.add_argument("--version", action="version", version=f"icpshap {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command")
    explain = _command(
        commands, "explain", "explain the uncertainty of one pair", EXPLAIN_EXAMPLES, _explain
    )
    explain.add_argument(
        "--what-if",
        nargs="*",
        metavar="NAME:KEY=VALUE,..",
        help="explain again with other options or levels, and say which helps; alone: more "
        "neighbours, a tighter stop, twice the points, a closer start",
    )
    _seed(explain, SEED)
    explain.add_argument(
        "--threads", type=_positive, metavar="N", help="changes no number (all cores)"
    )
    explain.add_argument("--json", action="store_true", help="print JSON instead of a screen")
    explain.add_argument("--html", metavar="FILE", help="write the report, one page with figures")
    explain.add_argument(
        "--covariance", metavar="FILE", help="write the covariance with all causes on, 6x6 numbers"
    )
    explain.add_argument(
        "--covariance-convention",
        choices=("icpshap", "gtsam", "ros"),
        default="icpshap",
        help="icpshap and gtsam: rotation first, in the frame of the source; ros: translation "
        "first, in the axes of the reference",
    )
    explain.add_argument("--save", metavar="FILE", help="write all of it, for Explanation.load")
    explain.add_argument("--quiet", action="store_true", help="print nothing but errors, and JSON")
    fit = _command(
        commands, "fit", "whether the options fit two scans, without ICP", FIT_EXAMPLES, _fit
    )
    diagnose = _command(
        commands,
        "diagnose",
        "what is wrong with two scans, beside healthy ones, without perturbing them",
        DIAGNOSE_EXAMPLES,
        _diagnose,
    )
    diagnose.add_argument(
        "--healthy",
        nargs="+",
        action="append",
        default=[],
        metavar=("A B", "T"),
        help="a pair of the same scanner in the same kind of place, which says what is usual, and "
        "its pose as of --transform; may be repeated",
    )
    diagnose.add_argument(
        "--sensor",
        metavar="NAME",
        help="where there is no such pair: the scanner whose published noise is taken, such as "
        "velodyne_vlp_16",
    )
    diagnose.add_argument(
        "--clean-runs",
        action="store_true",
        help="also run ICP without any perturbation, and say how often it ends in a wrong basin",
    )
    _seed(diagnose, SEED)
    diagnose.add_argument("--json", action="store_true", help="print JSON instead of a screen")
    _add_experiment(explain)
    _add_experiment(fit)
    bundle = _command(
        commands,
        "bundle",
        "write two scans to a file to attach to an issue",
        BUNDLE_EXAMPLES,
        _bundle,
    )
    bundle.add_argument("--output", metavar="FILE", required=True, help="a ZIP file")
    _add_experiment(bundle)
    _export_command(commands)
    return parser


def _export_command(commands):
    from icpshap.causes import CAUSES
    from icpshap.export import FORMATS

    purpose = "write covariances for other programs"
    command = _bare(commands, "export", purpose, EXPORT_EXAMPLES, _export)
    command.add_argument(
        "covariances",
        help="covariances.parquet of the workflow, or a file that explain --save wrote",
    )
    command.add_argument(
        "--to",
        required=True,
        choices=tuple(FORMATS),
        help="; ".join(f"{name}: {known.meaning}" for name, known in FORMATS.items()),
    )
    command.add_argument("--output", metavar="FILE", help="where to (standard output)")
    command.add_argument("--sequence", metavar="KEY", help="of a table of several sequences")
    command.add_argument("--clean", action="store_true", help="all causes off, not on")
    causes = command.add_argument_group("levels of the causes, where the table has several")
    for cause in CAUSES.values():
        _level(causes, cause, f"off is {cause.off:g}")


def _seed(command, usual):
    command.add_argument("--seed", type=int, default=usual, help=f"of all random numbers ({usual})")


def _level(group, cause, told):
    """The option that gives the level of a cause."""
    unit = f" [{cause.unit}]" if cause.unit else ""
    group.add_argument(
        f"--{cause.name.replace('_', '-')}",
        type=float,
        metavar=cause.symbol,
        help=f"{cause.title}{unit} ({told})",
    )


def _bare(commands, name, purpose, examples, run):
    """A command without arguments."""
    command = commands.add_parser(
        name,
        help=purpose,
        description=f"{purpose[0].upper()}{purpose[1:]}.",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=run)
    return command


def _command(commands, name, purpose, examples, run):
    """A command with the arguments that those of two scans have."""
    from icpshap.one_pair.given import PRESETS

    command = _bare(commands, name, purpose, examples, run)
    command.add_argument("reference", help="scan that is registered onto")
    command.add_argument("source", help="scan that is moved")
    command.add_argument(
        "--transform",
        metavar="T",
        help="the true pose, T_reference_source, p_reference = T p_source: a text file of a "
        "matrix, or 16, 12 or 7 numbers (tx ty tz qx qy qz qw); without it ICP's own answer counts",
    )
    command.add_argument(
        "--initial-transform", metavar="T", help="where ICP starts, if --transform is not given"
    )
    command.add_argument(
        "--estimator",
        default="lidar",
        metavar="NAME",
        help=f"{', '.join(PRESETS)}, or a kind of estimator (lidar)",
    )
    command.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="another option of the estimator, as in normal_neighbours=30; may be repeated",
    )
    command.add_argument(
        "--columns", metavar="x,y,z,..", help="columns of scan files that do not name theirs"
    )
    command.add_argument(
        "--drop-non-finite",
        action="store_true",
        help="leave out points that are not finite, and count them",
    )
    return command


def _add_experiment(command):
    """Another registration, and the levels of the causes."""
    from icpshap.causes import CAUSES
    from icpshap.one_pair.given import CAUSES_GIVEN

    command.add_argument(
        "--register",
        metavar="NAME",
        help="another registration: small_gicp, open3d, or module:function of your own, a function "
        "of reference, source and T_initial that returns T (4, 4)",
    )
    command.add_argument(
        "--perturbation",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="what the causes refer to, as in overlap_distance=0.3 [m]; may be repeated",
    )
    causes = command.add_argument_group("levels of the causes")
    for cause in CAUSES.values():
        usual = CAUSES_GIVEN.get(cause.name)
        _level(causes, cause, f"{f'{usual:g}' if usual else 'off'}; off is {cause.off:g}")


def _positive(text):
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text}, expected 1 or more")
    return number
