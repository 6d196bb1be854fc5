"""Write the pages and files that follow from the code: python -m docs.generate [--check]

docs/configuration.md and icpshap/config.schema.json from the options and the causes, docs/tables.md
from icpshap.tables, docs/figures/coalitions.svg from the causes and icpshap.explanation.shapley.
`--check` writes nothing and fails if one of them is out of date.
"""

import inspect
import io
import json
import sys
from itertools import groupby
from pathlib import Path

import matplotlib.pyplot as plt
import yaml
from matplotlib.patches import Rectangle

from icpshap import causes, options, presets, schema
from icpshap.causes._sensors import SENSORS
from icpshap.estimators import KINDS, option_owners
from icpshap.estimators._descriptors import CELL
from icpshap.explanation import shapley
from icpshap.explanation.method import Method
from icpshap.jobs import paths
from icpshap.report.figures import style
from icpshap.tables import TABLES, WITH_CAUSES, columns

DOCS = Path(__file__).parent
REPOSITORY = DOCS.parent
EDITORS_SCHEMA = REPOSITORY / "icpshap" / "config.schema.json"
# The paper's causes and one of its instances, as the example where a page needs one.
INSTANCE = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
NOTE = "<!-- Made by `python -m docs.generate`; do not edit. -->"

# --- configuration --------------------------------------------------------------------------------

CONFIGURATION = f"""\
# Every configuration key

{NOTE}

`config.yaml` is the paper's experiment, with a comment on each key. Change it there, or lay your
own values over it:

```bash
snakemake -j2 --config 'sequences=[stairs]' seed=7
snakemake -j2 --config 'estimators={{paper: {{runs: 200}}}}'
snakemake -j2 --configfile config/demo.yaml
```

- Mappings are merged, lists are replaced.
- Everything is checked before anything runs, and all errors are reported at once.
- Top-level keys that you do not give keep their value in `config.yaml`. Within an entry of your
  own, keys are required unless they say otherwise. Every option of an estimator has a default.

An editor that knows JSON schemas can complete and check the keys. For that, the first line of the
file names the schema, by a path relative to the file. In `config.yaml` it is
`# yaml-language-server: $schema=icpshap/config.schema.json`.
"""

NOTES = {
    "data.<sequence>": (
        "Exactly one of `archive`, `folder` and `simulated`: see [data.md](data.md)."
    ),
    "data.<sequence>.archive": "`url`, or `path`; where both are given, `path` is used.",
    "experiments.<name>": (
        "Keys that are not optional may also come from `based_on`. An experiment has either "
        "`estimator`, or `estimators: [a, b]`. Each of several makes an experiment with a folder "
        "of its own, `<name>_a` and `<name>_b`; `run: [<name>]` selects them all. f and the "
        "Shapley values of all, a row for each, are in `results/<name>/figures/by_estimator.png` "
        "and `results/<name>/tables/by_estimator.md`. All must have the same `divergence` and "
        "perturb alike (`sensor`, `overlap_shape`), or their values would not be of one quantity. "
        "Either key replaces both keys of the experiment that this one is `based_on`."
    ),
    "experiments.<name>.instances": (
        "Exactly one of the three. It names the 1 to 7 [causes](#causes) among which f is "
        "divided, each once. **Causes that are not named are off.** `waterfall` names the same "
        "ones.\n\n"
        "`instances: here` takes the causes that scans show, at the levels that the "
        "[diagnosis](diagnosis.md#explain-here) finds in each pair. `instances: {here: "
        "{initial_pose: 4}}` adds the initial pose, at a scale that you give."
    ),
}

ESTIMATORS = f"""\
Give a `kind`, or `based_on`, and the options that differ. Without either the kind is
`{presets.DEFAULT_KIND}`. An option that is not given has its default, which is its value in
`paper`. In the tables an empty cell means the default. [paper.md](paper.md) says what `paper`,
`released_code` and `robust` are for, [own_scans.md](own_scans.md) what `lidar` is, and
[estimators.md](estimators.md) what each kind computes. An option of another kind is an error.
"""

SHARED = """\
### Options of every kind

These say how the pair is perturbed and filtered, which variant of a cause acts, and how f is
computed from the estimates.
"""

CAUSES = """\
## Causes

`grid` and `fixed` of an experiment may name these. A level must lie in the range. *off* is the
reference value, at which a cause changes nothing (but for `overlap_removal: noisy`, which acts
there too). [causes.md](causes.md) says how each acts, [extending.md](extending.md#a-cause) how to
add one.
"""

SENSORS_PART = """\
### `sensor`

If a scanner is named, the noise of a point at the range r has the *published* standard deviation
times the level. The level then has no unit, and 1 is as published. Mind what the source says: an
*accuracy* is not a standard deviation, and is taken as one for want of better.
"""

LEVELS = """\
### `experiments.<name>.instances.grid.<cause>`

A list of levels, or
"""


def configuration():
    """The page that lists every key of the schema, every option of an estimator and every cause."""
    config = yaml.safe_load((REPOSITORY / "config.yaml").read_text(encoding="utf-8"))
    values = {"": config, "perturbation": config["perturbation"]}
    parts = [CONFIGURATION]
    for block, (path, *others) in _blocks(schema.configuration()):
        parts.append(f"## `{path}`\n" if path else "## Top level\n")
        if others:
            parts.append(f"The same in {', '.join(f'`{other}`' for other in others)}.\n")
        if path in NOTES:
            parts.append(NOTES[path] + "\n")
        if path == "estimators.<name>":
            parts += _estimators(block)
        else:
            own = path == "experiments.<name>"
            needed = schema.EXPERIMENT_KEYS if own else block.get("required", [])
            parts.append(_block_table(block, needed, values.get(path)))
    return "\n".join([*parts, *_causes()])


def _blocks(whole):
    """Every mapping of a schema, outermost first, with the paths of keys that lead to it.

    Not those of which the keys are the causes.
    """
    names = {"data": "<sequence>", "estimators": "<name>", "experiments": "<name>"}
    found = []

    def visit(path, block):
        if block.get("type") == "array":
            visit(f"{path}[]", block["items"])
        for part in block.get("oneOf", []):
            visit(path, part)
        properties = block.get("properties", {})
        if not properties.keys() - causes.CAUSES.keys():
            properties = {}
        if properties:
            for known, known_paths in found:
                if known["properties"] == properties:
                    known_paths.append(path)
                    return
            found.append((block, [path]))
        for key, value in properties.items():
            visit(f"{path}.{key}".lstrip("."), value)
        if path in names and isinstance(block.get("additionalProperties"), dict):
            visit(f"{path}.{names[path]}", block["additionalProperties"])

    visit("", whole)
    return found


def _block_table(block, needed, values):
    """A table of a block's keys, with the values of `config.yaml` where there are any."""
    rows = []
    for key, value in block["properties"].items():
        given = [_value(values[key])] if values else []
        optional = "" if values or key in needed else "optional: "
        rows.append([f"`{key}`", optional + _kind(value), *given, value["description"]])
    return _table(["key", "value", *(["in `config.yaml`"] if values else []), "meaning"], rows)


def _estimators(block):
    """What any estimator has, then the options of each kind with their defaults."""
    own = {key: value for key, value in block["properties"].items() if key in ("based_on", "kind")}
    parts = [ESTIMATORS, _block_table({"properties": own}, (), None), SHARED]
    owners = [owner for owner in option_owners(presets.DEFAULT_KIND) if owner not in KINDS.values()]
    parts.append(_options_table([*owners, Method], presets.DEFAULT_KIND))
    for name, kind in KINDS.items():
        parts.append(f"### `kind: {name}`\n")
        parts.append(_first_sentence(inspect.getmodule(kind)) + "\n")
        parts.append(f"It returns {_returned(kind.returns)}. {_seen(kind)}\n")
        for key, value in kind.defaults.items():
            parts.append(f"The default of `{key}` is {_value(value)} here.\n")
        if options.names(kind):
            parts.append(_options_table([kind], name))
        else:
            parts.append("It has no options of its own.\n")
    return parts


def _first_sentence(module):
    return inspect.getdoc(module).split("\n\n")[0].replace("\n", " ")


def _returned(returns):
    samples = "pose samples" * returns.samples
    covariances = "covariances" * returns.covariances
    return " and ".join(filter(None, (samples, covariances)))


def _seen(kind):
    if kind.sees is None:
        return "Every cause may be explained with it."
    names = ", ".join(f"`{name}`" for name in kind.sees)
    return f"These causes may be explained with it: {names}."


def _options_table(owners, kind):
    """A table of options with their defaults and, of the presets' kind, what the presets change."""
    named = {
        "released_code": presets.RELEASED_CODE,
        "robust": presets.ROBUST,
        "lidar": presets.LIDAR,
    }
    shown = named if kind == presets.DEFAULT_KIND else {}
    rows = []
    for owner in owners:
        defaults = options.defaults(owner)
        for key, value in options.properties(owner).items():
            default = _value(defaults[key]) if key in defaults else "must be given"
            others = [preset.options[key] for preset in shown.values()]
            cells = ["" if other == defaults[key] else _value(other) for other in others]
            rows.append([f"`{key}`", _kind(value), default, *cells, value["description"]])
    paper = ["default, `paper`"] if shown else ["default"]
    return _table(["key", "value", *paper, *(f"`{name}`" for name in shown), "meaning"], rows)


def _causes():
    """The causes with what is said of each, and how a grid gives levels."""
    rows = [
        [
            f"`{name}`",
            cause.title,
            cause.symbol,
            cause.unit or "-",
            f"`{cause.off:g}`",
            _limits(cause.range.schema) or "any",
            ", ".join(f"{level:g}" for level in cause.levels),
            cause.meaning + ".",
        ]
        for name, cause in causes.CAUSES.items()
    ]
    header = ["cause", "title", "symbol", "unit", "off", "range", "levels worth trying", "meaning"]
    levels = schema.configuration()["properties"]["experiments"]["additionalProperties"]
    _, forms = levels["properties"]["instances"]["oneOf"]
    levels = forms["properties"]["grid"]["properties"]
    _, start_stop_step = next(iter(levels.values()))["oneOf"]
    rows_of_levels = [
        [f"`{key}`", value["type"], value["description"]]
        for key, value in start_stop_step["properties"].items()
    ]
    return [
        CAUSES,
        _table(header, rows),
        SENSORS_PART,
        _sensors(),
        LEVELS,
        _table(["key", "value", "meaning"], rows_of_levels),
    ]


def _sensors():
    rows = [
        [f"`{key}`", sensor.title, sensor.says, sensor.formula, sensor.source]
        for key, sensor in SENSORS.items()
    ]
    return _table(["value", "scanner", "what is published", "published [m]", "source"], rows)


def _kind(value):
    """What a key may be set to, in words."""
    if "oneOf" in value:
        return " or ".join(_kind(part) for part in value["oneOf"])
    if "enum" in value:
        return ", ".join(f"`{choice}`" for choice in value["enum"])
    types = value.get("type", "object")
    return " or ".join(
        _type(name, value) for name in ([types] if isinstance(types, str) else types)
    )


def _type(name, value):
    names = {"object": "mapping", "boolean": "`true` or `false`", "null": "`null`"}
    if name == "array":
        return f"list of {_kind(value['items'])}" if "enum" in value["items"] else "list"
    if name not in ("integer", "number"):
        return names.get(name, name)
    return f"{name} {_limits(value)}".strip()


def _limits(value):
    """The range of a number in words."""
    symbols = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    limits = {symbols[key]: value[key] for key in symbols if key in value}
    return " and ".join(
        f"{symbol} {limit:,}" if isinstance(limit, int) else f"{symbol} {limit:g}"
        for symbol, limit in limits.items()
    )


def _value(value):
    if isinstance(value, dict):
        return "see below"
    if isinstance(value, list):
        return ", ".join(f"`{item}`" for item in value)
    return f"`{yaml.safe_dump(value).splitlines()[0]}`"


def _table(header, rows):
    lines = [header, ["---"] * len(header), *(map(plain, row) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def plain(text):
    """Text in which Markdown sees neither columns nor tags."""
    return text.replace("|", "\\|").replace("<", "&lt;")


def editors_schema():
    """The schema by which editors complete the keys of a configuration file."""
    return json.dumps(schema.for_editors(), indent=2, sort_keys=True, ensure_ascii=False) + "\n"


# --- tables ---------------------------------------------------------------------------------------

TABLES_PAGE = f"""\
# Every column of every table

{NOTE}

Most readers need [`shap`](#shap) (Shapley values), [`uncertainty`](#uncertainty) (f and pose errors
of each setting), [`directions`](#directions) and [`covariances`](#covariances).

The tables are Parquet files, for pandas, R, DuckDB and others. A file also holds each column's unit
and description, the plan that made it (configuration, seed, digests of code and data) and its
causes:

```python
import pandas
import pyarrow.parquet

path = "results/demo_same_perturbation/shap.parquet"
frame = pandas.read_parquet(path)
schema = pyarrow.parquet.read_schema(path)
schema.field("phi_sensor_noise").metadata, schema.metadata[b"icpshap"]
```

- *Causes*: some columns depend on the causes that the experiment names: a level of each, and in
  `shap` and `resampled` what each contributes. This page shows those of the paper's three causes.
  With other causes the columns have their names. A single cause has no interactions.
- *Units*: the unit *f* is that of the estimator's `divergence`: nats, or m and rad for
  `translation_rmse` and `rotation_rmse`. Poses and pose errors have the rotation first: xi =
  [rotation; translation].
- *Intervals, noise floor and warnings*: [uncertainty.md](uncertainty.md) says what they mean.
- *`instances: here`*: [then](diagnosis.md#explain-here) the rows of `runs`, `estimates`,
  `uncertainty`, `shap`, `directions`, `covariances` and `resampled` have the indices of the pair
  that is explained. `played_reference` and `played_source` at their end say which pair was run.
"""

PLACES = {
    "scans": paths.SCANS,
    "timed_scans": paths.SCANS,
    "poses": paths.POSES,
    "registrations": paths.REGISTRATIONS,
    "overlaps": paths.OVERLAPS,
    "fit_numbers": paths.FIT_NUMBERS,
    "diagnosis": paths.DIAGNOSIS,
    "instances": paths.INSTANCES,
    "runs": paths.RUNS,
    "estimates": paths.ESTIMATES,
    "descriptors": paths.DESCRIPTORS,
}
ROWS = {
    "scans": "a point",
    "timed_scans": "a point of a scan whose file says when it was measured",
    "poses": "a scan",
    "registrations": "two consecutive scans; there is one, where ICP makes the poses",
    "overlaps": "a source point of a pair, in the order of its scan",
    "pairs": "a pair, registered or not",
    "fit_numbers": "a pair: what the checks of how the settings fit the scans are made from",
    "diagnosis": "a pair: what is wrong with it, beside the other pairs of the sequence",
    "instances": "a pair, with `instances: here`: the levels explained, and the pair that is run",
    "fit": "a check of a pair: the number, what is right, the change that mends it",
    "runs": "a pose sample: an ICP run",
    "estimates": "the covariance of a setting in one noise draw",
    "descriptors": "a setting, to learn from: what its clouds look like, and how its runs spread",
    "uncertainty": "a setting: a perturbation that was run on a pair",
    "shap": "an instance: a perturbation of a pair that is explained",
    "directions": "a direction of an instance, or the squared error of one",
    "covariances": "a setting: how the pose varies in it",
    "resampled": "a bootstrap resample of an instance, for the ranking of the causes",
}
NOTES_OF_TABLES = {
    "runs": "For estimators that return pose samples. A job holds one pair or several.",
    "estimates": "For estimators that return covariances. A job holds one pair or several.",
    "covariances": (
        "The covariance of the runs from which the setting's `f` in `uncertainty` is computed, "
        "without the floor. For estimators that return covariances, it is their mean over the "
        "noise draws. `icpshap export` writes it [for SLAM](export.md)."
    ),
    "descriptors": (
        "For experiments that an estimator of the kind `learned` names in `training`. Cells are "
        f"cubes of {CELL} m in which both scans have points; everything is in the source's axes."
    ),
}


def tables():
    """The page that lists every column of every table."""
    parts = [TABLES_PAGE]
    for table in TABLES:
        known = columns(table, causes.named(INSTANCE) if table in WITH_CAUSES else ())
        parts.append(f"## {table}\n\n{_places(table)}\n\nA row is {ROWS[table]}.\n")
        if table in NOTES_OF_TABLES:
            parts.append(NOTES_OF_TABLES[table] + "\n")
        alike = groupby(known, lambda column: (column.type, column.unit, column.description))
        rows = [[_names(list(group)), *what] for what, group in alike]
        parts.append(_table(["column", "type", "unit", "meaning"], rows))
    return "\n".join(parts)


def _places(table):
    if table in PLACES:
        return f"`{PLACES[table]}`"
    both = (paths.OF_SEQUENCE, paths.OF_EXPERIMENT)
    return ", ".join(f"`{paths.at(template, table=table)}`" for template in both)


def _names(columns):
    names = [f"`{column.name}`" for column in columns]
    return ", ".join(names) if len(names) <= 3 else f"{names[0]} to {names[-1]}"


# --- figure ---------------------------------------------------------------------------------------


def coalitions():
    """The mapping h_x from coalitions to the perturbations that are run, as SVG."""
    players = causes.named(INSTANCE)
    on = shapley.coalitions(len(players))
    instance = [INSTANCE[cause.name] for cause in players]
    values = shapley.coalition_values([instance], [cause.off for cause in players])[0]
    by_size = sorted(range(len(on)), key=lambda k: (on[k].sum(), k))
    gap = 1.6 * len(players)  # between the coalitions and the settings, for the arrows
    places = [(0.2 + 1.6 * k, gap + 2.7 + 2.2 * k) for k in range(len(players))]
    with style.styled():
        figure = plt.figure(figsize=(style.PAGE, 0.8 + 0.24 * len(on)), layout="none")
        axes = figure.add_axes([0, 0, 1, 1])
        axes.set(xlim=(0, places[-1][1] + 2), ylim=(len(on) + 0.1, -1.8))
        axes.set_axis_off()
        _coalition_headings(axes, players, places, gap)
        for row, k in enumerate(by_size):
            arrow = {"arrowstyle": "->", "color": style.MUTED, "linewidth": 0.8}
            axes.annotate("", (gap + 2.1, row + 0.5), (gap + 0.5, row + 0.5), arrowprops=arrow)
            for cause, place, here, value in zip(players, places, on[k], values[k], strict=True):
                _coalition_cells(axes, row, cause, place, here, value)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        plt.close(figure)
    return file.getvalue()


def _coalition_headings(axes, players, places, gap):
    centred = {"ha": "center", "va": "center"}
    axes.text(gap / 2 - 0.05, -1.35, "coalition z′", fontsize=8, **centred)
    middle = (places[0][1] + places[-1][1] + 1.8) / 2
    axes.text(middle, -1.35, "setting z", fontsize=8, **centred)
    axes.text(gap + 1.3, -0.6, "h$_x$", fontsize=8, **centred)
    for cause, (left, right) in zip(players, places, strict=True):
        unit = f" [{cause.unit}]" if cause.unit else ""
        axes.text(left + 0.55, -0.6, cause.title.replace(" ", "\n", 1), **centred)
        axes.text(right + 0.9, -0.6, f"{cause.symbol}{unit}", **centred)


def _coalition_cells(axes, row, cause, place, here, value):
    """Whether a cause is on in a coalition, and its value in the setting."""
    colour = cause.colour if here else style.FAINT
    ink = "white" if here else style.MUTED
    for x, width, text in zip(place, (1.1, 1.8), (f"{here:d}", f"{value:g}"), strict=True):
        axes.add_patch(Rectangle((x, row + 0.1), width, 0.8, color=colour, lw=0))
        axes.text(x + width / 2, row + 0.53, text, color=ink, ha="center", va="center")


# --- writing --------------------------------------------------------------------------------------


def generated():
    """Content of every generated file, by path."""
    return {
        DOCS / "configuration.md": configuration(),
        DOCS / "tables.md": tables(),
        DOCS / "figures" / "coalitions.svg": coalitions(),
        EDITORS_SCHEMA: editors_schema(),
    }


def outdated():
    """Paths of the generated files that differ from what would be written now."""
    return [
        path
        for path, content in generated().items()
        if not path.is_file() or path.read_text(encoding="utf-8") != content
    ]


def main(arguments):
    if "--check" in arguments:
        names = [str(path.relative_to(REPOSITORY)) for path in outdated()]
        if names:
            sys.exit(f"Out of date: {', '.join(names)}.\nHint: python -m docs.generate")
        return
    for path, content in generated().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
