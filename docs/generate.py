"""Write the pages and the figure that follow from the code: python -m docs.generate [--check]

docs/configuration.md from workflow/schemas/config.schema.yaml and config.yaml, docs/tables.md from
icpshap.tables, docs/figures/coalitions.svg from icpshap.shapley. `--check` writes nothing and fails
if one of them is out of date.
"""

import io
import sys
from itertools import groupby
from pathlib import Path

import matplotlib.pyplot as plt
import yaml
from matplotlib.patches import Rectangle

from icpshap import config as settings
from icpshap.causes import SOURCES
from icpshap.config import EXPERIMENT_KEYS
from icpshap.explanation import shapley
from icpshap.report.figures import style
from icpshap.tables import TABLES

DOCS = Path(__file__).parent
INSTANCE = (0.05, 1.5, 0.05)
NOTE = "<!-- Made by `python -m docs.generate`; do not edit. -->"

# --- configuration --------------------------------------------------------------------------------

CONFIGURATION = f"""\
# Every configuration key

{NOTE}

`config.yaml` is the paper's experiment, with a comment above each key. Change it there, or lay
something over it:

```bash
snakemake -j2 --config 'sequences=[stairs]' seed=7
snakemake -j2 --config 'estimators={{paper: {{runs: 200}}}}'
snakemake -j2 --configfile config/demo.yaml
```

Mappings are merged, lists are replaced. Everything is checked before anything runs, and all errors
are reported at once. Top-level keys that you do not give keep their value in `config.yaml`; within
an entry of your own, keys are required unless they say otherwise.
"""

NOTES = {
    "data.<sequence>": (
        "Exactly one of `archive`, `folder` and `simulated`: see [data.md](data.md)."
    ),
    "data.<sequence>.archive": "`url`, or `path`; where both are given, `path` is used.",
    "estimators.<name>": (
        "Give every key, or `based_on` and those that differ. An empty cell is the value of "
        "`paper`. What the three estimators are for: [paper.md](paper.md)."
    ),
    "experiments.<name>": "Keys that are not optional may also come from `based_on`.",
    "experiments.<name>.instances": "Exactly one of the two.",
}


def configuration(schema, config):
    """The page that lists every key of the schema, with its value in the configuration."""
    values = {"": config, "perturbation": config["perturbation"]}
    parts = [CONFIGURATION]
    for block, (path, *others) in _blocks(schema, schema["$defs"]):
        parts.append(f"## `{path}`\n" if path else "## Top level\n")
        if others:
            parts.append(f"The same in {', '.join(f'`{other}`' for other in others)}.\n")
        if path in NOTES:
            parts.append(NOTES[path] + "\n")
        if path == "estimators.<name>":
            parts.append(_estimator_table(block, config["estimators"]))
        else:
            needed = EXPERIMENT_KEYS if path == "experiments.<name>" else block.get("required", [])
            parts.append(_block_table(block, needed, values.get(path)))
    return "\n".join(parts)


def _blocks(schema, definitions):
    """Every mapping of a schema, outermost first, with the paths of keys that lead to it."""
    names = {"data": "<sequence>", "estimators": "<name>", "experiments": "<name>"}
    found = []

    def visit(path, block):
        block = _resolved(block, definitions)
        for part in block.get("oneOf", []):
            visit(path, part)
        if block.get("type") == "array":
            visit(f"{path}[]", block["items"])
        if "properties" in block:
            for known, paths in found:
                if known["properties"] == block["properties"]:
                    paths.append(path)
                    return
            found.append((block, [path]))
        for key, value in block.get("properties", {}).items():
            visit(f"{path}.{key}".lstrip("."), value)
        if isinstance(block.get("additionalProperties"), dict):
            visit(f"{path}.{names[path]}", block["additionalProperties"])

    visit("", schema)
    return [(_with_resolved(block, definitions), paths) for block, paths in found]


def _resolved(block, definitions):
    """A block with the definition that it refers to; its own keys win."""
    if "$ref" not in block:
        return block
    own = {key: value for key, value in block.items() if key != "$ref"}
    return {**definitions[block["$ref"].rpartition("/")[2]], **own}


def _with_resolved(block, definitions):
    properties = block["properties"].items()
    return {**block, "properties": {key: _resolved(v, definitions) for key, v in properties}}


def _block_table(block, needed, values):
    """A table of a block's keys, with the values of `config.yaml` where there are any."""
    rows = []
    for key, value in block["properties"].items():
        given = [_value(values[key])] if values else []
        optional = "" if values or key in needed else "optional: "
        rows.append([f"`{key}`", optional + _kind(value), *given, value["description"]])
    return _table(["key", "value", *(["in `config.yaml`"] if values else []), "meaning"], rows)


def _estimator_table(block, estimators):
    rows = []
    for key, value in block["properties"].items():
        cells = [_value(own[key]) if key in own else "" for own in estimators.values()]
        rows.append([f"`{key}`", _kind(value), *cells, value["description"]])
    return _table(["key", "value", *(f"`{name}`" for name in estimators), "meaning"], rows)


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
    symbols = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤"}
    limits = [f"{symbols[key]} {value[key]:g}" for key in symbols if key in value]
    return f"{name} {' and '.join(limits)}".strip()


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


# --- tables ---------------------------------------------------------------------------------------

TABLES_PAGE = f"""\
# Every column of every table

{NOTE}

Parquet files, for pandas, R, DuckDB and others. Each column's unit and description are in the file
too, beside what decided its numbers (seed, estimator, digests of data and code):

```python
import pandas
import pyarrow.parquet

path = "results/demo_same_perturbation/shap.parquet"
frame = pandas.read_parquet(path)
schema = pyarrow.parquet.read_schema(path)
schema.field("phi_sensor_noise").metadata, schema.metadata[b"icpshap"]
```

The unit *f* is that of the estimator's `divergence`: nats, or m and rad for `translation_rmse` and
`rotation_rmse`. Poses and pose errors have the rotation first: xi = [rotation; translation]. What
intervals, noise floor and warnings mean: [uncertainty.md](uncertainty.md).
"""

PLACES = {
    "scan": "resources/{sequence}/scan_{index}.parquet",
    "poses": "resources/{sequence}/poses.parquet",
    "overlap": "resources/{sequence}/overlap/{reference}-{source}.parquet",
    "runs": "results/{experiment}/{sequence}/runs/{reference}-{source}/{chunk}.parquet",
}
ROWS = {
    "scan": "a point",
    "poses": "a scan",
    "overlap": "a source point, in the order of its scan",
    "pairs": "a pair, registered or not",
    "runs": "an ICP run",
    "uncertainty": "a setting: a perturbation that was run on a pair",
    "shap": "an instance: a perturbation of a pair that is explained",
    "resampled": "a bootstrap resample of an instance, for the ranking of the sources",
}


def tables():
    """The page that lists every column of every table."""
    parts = [TABLES_PAGE]
    for table, columns in TABLES.items():
        where = PLACES.get(table, f"results/{{experiment}}/{{sequence}}/{table}.parquet")
        both = "" if table in PLACES else f", `results/{{experiment}}/{table}.parquet`"
        row = f"A row is {ROWS[table]}.\n" if table in ROWS else ""
        parts.append(f"## {table}\n\n`{where}`{both}\n\n{row}")
        alike = groupby(columns, lambda column: (column.type, column.unit, column.description))
        rows = [[_names(list(group)), *what] for what, group in alike]
        parts.append(_table(["column", "type", "unit", "meaning"], rows))
    return "\n".join(parts)


def _names(columns):
    names = [f"`{column.name}`" for column in columns]
    return ", ".join(names) if len(names) <= 3 else f"{names[0]} to {names[-1]}"


# --- figure ---------------------------------------------------------------------------------------


def coalitions():
    """The mapping h_x from coalitions to the perturbations that are run, as SVG."""
    on = shapley.coalitions(len(SOURCES))
    values = shapley.coalition_values([INSTANCE], [source.off for source in SOURCES])[0]
    by_size = sorted(range(len(on)), key=lambda k: (on[k].sum(), k))
    gap = 1.6 * len(SOURCES)  # between the coalitions and the settings, for the arrows
    columns = [(0.2 + 1.6 * k, gap + 2.7 + 2.2 * k) for k in range(len(SOURCES))]
    with style.styled():
        figure = plt.figure(figsize=(style.PAGE, 0.8 + 0.24 * len(on)), layout="none")
        axes = figure.add_axes([0, 0, 1, 1])
        axes.set(xlim=(0, columns[-1][1] + 2), ylim=(len(on) + 0.1, -1.8))
        axes.set_axis_off()
        centred = {"ha": "center", "va": "center"}
        axes.text(gap / 2 - 0.05, -1.35, "coalition z′", fontsize=8, **centred)
        middle = (columns[0][1] + columns[-1][1] + 1.8) / 2
        axes.text(middle, -1.35, "setting z", fontsize=8, **centred)
        axes.text(gap + 1.3, -0.6, "h$_x$", fontsize=8, **centred)
        for source, (left, right) in zip(SOURCES, columns, strict=True):
            unit = f" [{source.unit}]" if source.unit else ""
            axes.text(left + 0.55, -0.6, source.title.replace(" ", "\n", 1), **centred)
            axes.text(right + 0.9, -0.6, f"{source.symbol}{unit}", **centred)
        for row, k in enumerate(by_size):
            arrow = {"arrowstyle": "->", "color": style.MUTED, "linewidth": 0.8}
            axes.annotate("", (gap + 2.1, row + 0.5), (gap + 0.5, row + 0.5), arrowprops=arrow)
            for source, places, here, value in zip(SOURCES, columns, on[k], values[k], strict=True):
                colour = style.COLOURS.get(source.name, style.INK) if here else style.FAINT
                ink = "white" if here else style.MUTED
                for x, width, text in zip(
                    places, (1.1, 1.8), (f"{here:d}", f"{value:g}"), strict=True
                ):
                    axes.add_patch(Rectangle((x, row + 0.1), width, 0.8, color=colour, lw=0))
                    axes.text(x + width / 2, row + 0.53, text, color=ink, **centred)
        file = io.StringIO()
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
        plt.close(figure)
    return file.getvalue()


# --- writing --------------------------------------------------------------------------------------


def generated():
    """Content of every generated file, by path."""
    config = yaml.safe_load((DOCS.parent / "config.yaml").read_text())
    return {
        DOCS / "configuration.md": configuration(settings.read_schema(), config),
        DOCS / "tables.md": tables(),
        DOCS / "figures" / "coalitions.svg": coalitions(),
    }


def outdated():
    """Paths of the generated files that differ from what would be written now."""
    return [
        path
        for path, content in generated().items()
        if not path.is_file() or path.read_text() != content
    ]


def main(arguments):
    if "--check" in arguments:
        names = [str(path.relative_to(DOCS.parent)) for path in outdated()]
        if names:
            sys.exit(f"Out of date: {', '.join(names)}.\nHint: python -m docs.generate")
        return
    for path, content in generated().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(content)


if __name__ == "__main__":
    main(sys.argv[1:])
