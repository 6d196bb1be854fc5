"""The command icpshap: explain one pair of scans, or say whether the options fit it.

Exit status: 0 done, 1 data or options that cannot be used, 2 a wrong command line, 130 stopped.
"""

import argparse
import os
import shutil
import sys
from collections.abc import Sequence
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
FIT_EXAMPLES = """\
examples:
  icpshap fit reference.pcd source.pcd --transform T.txt
  icpshap fit a.ply b.ply --estimator paper
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    given = _parser().parse_args(_joined(arguments))
    # A terminal or a file may not know every letter.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        given.run(given)
    except UserError as error:
        print(f"icpshap: {error}", file=sys.stderr)
        return DATA_ERROR
    except KeyboardInterrupt:
        print("\nicpshap: stopped", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:
        # Who read it has seen enough; nothing more may be written at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


# --- explain --------------------------------------------------------------------------------------


def _explain(given: argparse.Namespace) -> None:
    from icpshap.one_pair.explanation import writable
    from icpshap.one_pair.recipe import explain

    _compiling(given)
    for path in filter(None, (given.html, given.covariance, given.save)):
        _require_folder(path)
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
        seed=given.seed,
        threads=given.threads,
        progress=not given.quiet and sys.stderr.isatty(),
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
        print(explanation.to_json(), end="")
    elif not given.quiet:
        width = min(shutil.get_terminal_size((100, 40)).columns, 100)
        colours = sys.stdout.isatty() and "NO_COLOR" not in os.environ
        print(explanation.to_text(width, colours))


def _fit(given: argparse.Namespace) -> None:
    from icpshap.fit import checks
    from icpshap.one_pair.recipe import fit_table

    reference, source = _scans(given)
    found = fit_table(
        reference,
        source,
        _transform(given.transform),
        causes=_causes(given),
        estimator=_estimator(given),
        T_initial=_transform(given.initial_transform),
    )
    for row in found.itertuples():
        print(f"{row.grade:<7} {row.check:<17} {checks.said(row)}")


# --- what was typed -------------------------------------------------------------------------------


def _scans(given):
    from icpshap.one_pair.given import read_scan

    columns = given.columns.split(",") if given.columns else None
    return [read_scan(path, columns) for path in (given.reference, given.source)]


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

    typed = {name: getattr(given, name) for name in CAUSES if getattr(given, name) is not None}
    levels = {**CAUSES_GIVEN, **typed}
    kept = {name: level for name, level in levels.items() if level != CAUSES[name].off}
    if not kept:
        raise UserError("All causes are off.\nHint: give one of them a level.")
    return kept


def _estimator(given):
    options = {}
    for text in given.option:
        options |= dict([_option(text, "--option")])
    return {"based_on": given.estimator, **options} if options else given.estimator


def _option(text, where):
    """Key and value of KEY=VALUE."""
    key, sign, value = text.partition("=")
    if not sign:
        raise UserError(f"{where} {text}: expected KEY=VALUE.\nHint: such as normal_neighbours=30.")
    return key.strip(), value.strip()


def _register(name):
    """A registration of icpshap.registrations by its name, or module:function."""
    return f"icpshap.registrations:{name}" if name and ":" not in name else name


def _what_if(texts):
    """True for the changes that are usual, else those named, NAME:KEY=VALUE,KEY=VALUE."""
    if texts is None:
        return False
    if not texts:
        return True
    changes = {}
    for text in texts:
        name, sign, listed = text.partition(":")
        if not sign:
            listed = name
            name = "".join(letter if letter.isalnum() else "_" for letter in listed.lower())
        changes[name] = dict(_option(part, "--what-if") for part in listed.split(","))
    return changes


def _require_folder(path):
    """Raise UserError where a file could not be written, before anything is computed."""
    folder = Path(path).absolute().parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise UserError(
            f"{path}: cannot be written, {folder} is no folder that you may write to.\n"
            "Hint: make the folder, or give another place."
        )


def _compiling(given):
    """Say that the engine is compiled, which takes a while, where it is."""
    import logging

    if not given.quiet:
        logging.basicConfig(format="%(message)s", level=logging.WARNING, stream=sys.stderr)
        logging.getLogger("icpshap.icp.compiled").setLevel(logging.INFO)


def _joined(arguments):
    """Numbers behind a transform as one word: argparse takes some that are negative for options."""
    result: list[str] = []
    place = 0
    while place < len(arguments):
        result.append(arguments[place])
        place += 1
        if result[-1] in ("--transform", "--initial-transform"):
            first = place
            while place < len(arguments) and _numbers([arguments[place]]) is not None:
                place += 1
            if place > first:
                result[-1] += "=" + " ".join(arguments[first:place])
    return result


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="icpshap",
        description="Why is the registration of two scans uncertain?",
        epilog="icpshap explain --help and icpshap fit --help have examples.",
    )
    parser.add_argument("--version", action="version", version=f"icpshap {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command")
    explain = _command(
        commands, "explain", "explain the uncertainty of one pair", EXPLAIN_EXAMPLES, _explain
    )
    explain.add_argument(
        "--register",
        metavar="NAME",
        help="another registration: small_gicp, open3d, or module:function of your own, a function "
        "of reference, source and T_initial that returns T (4, 4)",
    )
    explain.add_argument(
        "--what-if",
        nargs="*",
        metavar="NAME:KEY=VALUE,..",
        help="explain again with other options or levels, and say which helps; alone: more "
        "neighbours, a tighter stop, twice the points, a closer start",
    )
    explain.add_argument("--seed", type=int, default=42, help="of all random numbers (42)")
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
    _command(commands, "fit", "whether the options fit two scans, without ICP", FIT_EXAMPLES, _fit)
    return parser


def _command(commands, name, purpose, examples, run):
    """A command with the arguments that all have."""
    from icpshap.causes import CAUSES
    from icpshap.one_pair.given import CAUSES_GIVEN, PRESETS

    command = commands.add_parser(
        name,
        help=purpose,
        description=f"{purpose[0].upper()}{purpose[1:]}.",
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=run)
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
    causes = command.add_argument_group("levels of the causes")
    for cause in CAUSES.values():
        unit = f" [{cause.unit}]" if cause.unit else ""
        usual = CAUSES_GIVEN.get(cause.name)
        causes.add_argument(
            f"--{cause.name.replace('_', '-')}",
            type=float,
            metavar=cause.symbol,
            help=f"{cause.title}{unit} ({f'{usual:g}' if usual else 'off'}; off is {cause.off:g})",
        )
    return command


def _positive(text):
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text}, expected 1 or more")
    return number
