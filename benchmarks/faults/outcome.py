"""A fault, what came of it, and how outcomes are counted and shown."""

import json
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from icpshap.errors import UserError

KINDS = ("right", "told", "wrong", "crash", "hang")
BAD = KINDS[2:]


@dataclass(frozen=True)
class Outcome:
    """right: the right result; told: refused by name; and the three that must not be."""

    kind: str
    detail: str = ""


@dataclass(frozen=True)
class Fault:
    """A fault in words, and the function that does it, looks, and returns its Outcome."""

    text: str
    attempt: Callable[[], Outcome]


@dataclass(frozen=True)
class Tried:
    """A fault of a family with its outcome."""

    family: str
    fault: str
    outcome: Outcome


RIGHT = Outcome("right")


def said_of(message, *names):
    """The outcome of an error's text: told if it says any of the names, else a crash."""
    if is_traceback(message):
        return Outcome("crash", tail(message))
    if any(str(name) in message for name in names):
        return Outcome("told", tail(message))
    return Outcome("crash", f"names none of {', '.join(map(str, names))}: {tail(message)}")


def is_traceback(message):
    """Whether a text holds a traceback, as Python or as Snakemake prints it.

    One line of it is Snakemake's way to say which file of rules refused a configuration.
    """
    return "Traceback (most recent call last)" in message or message.count('\n  File "') > 1


def of_call(call, is_right, *names):
    """The outcome of a function of the library, whose errors must say any of the names."""
    try:
        result = call()
    except UserError as error:
        return said_of(str(error), *names)
    except Exception as error:  # whatever else comes would reach the user as a traceback
        where = traceback.extract_tb(error.__traceback__)[-1]
        line = f"{where.filename.rpartition('/')[2]}:{where.lineno}"
        return Outcome("crash", f"{type(error).__name__} at {line}: {error}"[:400])
    return RIGHT if is_right(result) else Outcome("wrong", "another result without a word")


def tail(text, length=400):
    text = text.strip()
    return text if len(text) <= length else f"... {text[-length:]}"


def table(tried):
    """Markdown: a row for each family, its faults and their outcomes by kind."""
    lines = ["| family | faults | " + " | ".join(KINDS) + " |", "|---|" + "---:|" * 6]
    families = list(dict.fromkeys(one.family for one in tried))
    for family in [*families, None]:
        counts = Counter(one.outcome.kind for one in tried if family in (None, one.family))
        numbers = [counts.total(), *(counts[kind] for kind in KINDS)]
        lines.append(f"| {family or 'all'} | " + " | ".join(map(str, numbers)) + " |")
    return "\n".join(lines)


def summary(tried):
    """JSON: the number of faults and of each kind of bad outcome."""
    counts = Counter(one.outcome.kind for one in tried)
    return json.dumps({"faults": len(tried), **{kind: counts[kind] for kind in BAD}})
