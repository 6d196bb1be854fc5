"""An option: its default, type, range, unit and meaning, said once.

Options are the fields of frozen dataclasses, made by `option`; every part of the library declares
those it reads. The schema of the configuration, its documentation, the presets and the comments of
config.yaml follow from these fields or are tested against them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, dataclass, field, fields
from types import NoneType, UnionType
from typing import Any, get_args, get_type_hints

TYPES = {int: "integer", float: "number", str: "string", bool: "boolean", NoneType: "null"}
REQUIRED = MISSING  # the default of an option that must be given


@dataclass(frozen=True)
class Range:
    """Which numbers are allowed: from `minimum` to `maximum`, or between `above` and `below`."""

    minimum: float | None = None
    above: float | None = None
    maximum: float | None = None
    below: float | None = None

    @property
    def schema(self) -> dict[str, float]:
        """The JSON schema's keywords.

        >>> Range(above=0, maximum=1).schema
        {'exclusiveMinimum': 0, 'maximum': 1}
        """
        keywords = {
            "minimum": self.minimum,
            "exclusiveMinimum": self.above,
            "maximum": self.maximum,
            "exclusiveMaximum": self.below,
        }
        return {keyword: limit for keyword, limit in keywords.items() if limit is not None}


def option(
    default: Any,
    meaning: str,
    *,
    unit: str | None = None,
    choices: Sequence[str | int] | None = None,
    schema: dict[str, Any] | Callable[[], dict[str, Any]] | None = None,
    variant: bool = False,
    **limits: float,
) -> Any:
    """The field of an option.

    meaning: what it is, as documentation and errors say it, without the full stop; unit: "-" for a
    number without one, None for what is no number; choices: the only values; limits: of a `Range`;
    schema: JSON schema of a value that is more than a number, a word or a truth value, or a
    function that makes it when it is asked for; variant: whether any value but the default makes a
    variant of its owner, of which plans and tables speak only then: those that were made before the
    option existed still hold.
    """
    metadata = {
        "meaning": meaning + (f" [{unit}]" if unit else "") + ".",
        "choices": choices,
        "range": Range(**limits),
        "schema": schema or {},
        "variant": variant,
    }
    return field(default=default, metadata=metadata)


def names(owner: object) -> list[str]:
    """Names of the options of a class or an instance, in their order."""
    return [part.name for part in _options(owner)]


def properties(owner: type) -> dict[str, dict[str, Any]]:
    """JSON schema of each option of a class, by name."""
    hints = get_type_hints(owner)
    return {part.name: _property(part.metadata, hints[part.name]) for part in _options(owner)}


def block(owner: type, description: str = "", required: Iterable[str] = ()) -> dict[str, Any]:
    """JSON schema of a closed mapping that holds the options of a class.

    required: names that must be given besides the options that have no default.
    """
    needed = without_default(owner)
    needed += [name for name in required if name not in needed]
    return {
        **({"description": description} if description else {}),
        "type": "object",
        "additionalProperties": False,
        **({"required": needed} if needed else {}),
        "properties": properties(owner),
    }


def without_default(owner: type) -> list[str]:
    """Names of the options of a class that have no default."""
    return [part.name for part in _options(owner) if part.default is REQUIRED]


def defaults(owner: object) -> dict[str, Any]:
    """The default of each option of a class that has one, by name."""
    return {part.name: part.default for part in _options(owner) if part.default is not REQUIRED}


def values(owner: object) -> dict[str, Any]:
    """The options of an instance, by name."""
    return {name: getattr(owner, name) for name in names(owner)}


def variant(owner: object) -> dict[str, Any]:
    """The options by which an instance is a variant, by name; none where it is the usual one."""
    return {
        part.name: getattr(owner, part.name)
        for part in _options(owner)
        if part.metadata["variant"] and getattr(owner, part.name) != part.default
    }


def deciding(owner: object) -> dict[str, Any]:
    """The options of an instance as a plan holds them: those of a variant only where it is one."""
    others = {part.name for part in _options(owner) if part.metadata["variant"]}
    others -= set(variant(owner))
    return {name: value for name, value in values(owner).items() if name not in others}


def _options(owner):
    """The fields that `option` made."""
    return [part for part in fields(owner) if "meaning" in part.metadata]


def _property(metadata, annotation):
    described = {"description": metadata["meaning"]}
    schema = metadata["schema"]() if callable(metadata["schema"]) else metadata["schema"]
    if schema:
        return described | schema
    kinds = get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
    words = [TYPES[kind] for kind in kinds]
    described["type"] = words[0] if len(words) == 1 else words
    if metadata["choices"]:
        described["enum"] = list(metadata["choices"])
    return described | metadata["range"].schema
