"""Every key of the configuration, edited once: what is made again, and whether it had to be.

What a key decides stands here by hand; besides, the numbers themselves are asked: where another
value gives other runs or other Shapley values, their plan must be another.
"""

import copy
from functools import partial
from pathlib import Path

import yaml

from benchmarks.faults import in_process
from benchmarks.faults.outcome import RIGHT, Fault, Outcome
from benchmarks.faults.workplace import CONFIG, TABLES
from icpshap import options, presets, schema, storage
from icpshap.causes import CAUSES
from icpshap.explanation.method import Method
from icpshap.jobs import few
from icpshap.jobs.plans import digest

EXPERIMENT, SEQUENCE, ROOM = "tiny_fixed", "own", "tiny_room"
STEPS = ("scan", "simulated", "poses", "overlap", "pair", "job", "explanation", "joined")
AFTER = {
    "scan": {"overlap", "pair", "job", "explanation", "joined"},
    "poses": {"overlap", "pair", "job", "explanation", "joined"},
    "simulated": set(),
    "overlap": {"pair", "job", "explanation", "joined"},
    "pair": {"explanation", "joined"},
    "job": {"explanation", "joined"},
    "cut": {"job"},
    "explanation": {"joined"},
    "joined": set(),
}
RULES = {
    "scan": "read_scans",
    "simulated": "simulate_scans",
    "poses": "read_poses",
    "pair": "check_pairs",
    "job": "run_icp",
    "explanation": "explain_sequence",
    "joined": "join_sequences",
}
TINY = ("estimators", "tiny")
INSTANCE = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
# Path of a key: another value, and the first steps that it decides.
EDITS = {
    ("seed",): (7, {"simulated", "pair", "job", "explanation"}),
    ("sequences",): (["own"], set()),
    ("run",): ([EXPERIMENT], set()),
    ("runs_per_job",): (120, {"cut"}),
    ("stop_at_red",): (True, set()),
    ("perturbation", "initial_pose_rotation"): (5, {"job"}),
    ("perturbation", "initial_pose_translation"): (0.1, {"job"}),
    ("perturbation", "overlap_distance"): (0.3, {"overlap"}),
    ("perturbation", "minimum_overlap"): (0.2, {"pair"}),
    ("data", SEQUENCE, "title"): ("Another", set()),
    ("data", ROOM, "scans"): (3, set()),
    ("data", SEQUENCE, "drop_non_finite"): (True, {"scan"}),
    ("data", SEQUENCE, "time"): ("stamp", {"scan"}),
    ("data", SEQUENCE, "folder", "path"): ("others", {"scan", "poses"}),
    ("data", SEQUENCE, "folder", "poses"): ("poses_2.txt", {"poses"}),
    ("data", SEQUENCE, "folder", "files"): (["s1.csv", "s0.csv", "s2.csv"], {"scan"}),
    ("data", SEQUENCE, "folder", "columns"): (["y", "x", "z"], {"scan", "poses"}),
    ("data", SEQUENCE, "folder", "quaternion"): ("wxyz", {"poses"}),
    ("data", ROOM, "simulated", "scene"): ("plain", {"simulated"}),
    ("data", ROOM, "simulated", "beams"): (4000, {"simulated"}),
    ("data", ROOM, "simulated", "rings"): (16, {"simulated"}),
    ("data", ROOM, "simulated", "range_noise"): (0.005, {"simulated"}),
    ("experiments", EXPERIMENT, "estimator"): ("robust", {"pair", "job"}),
    ("experiments", EXPERIMENT, "sequences"): (["own", ROOM], {"joined"}),
    ("experiments", EXPERIMENT, "pairs"): (
        [{"sequence": "own", "reference": 0, "source": 1}],
        {"pair", "explanation"},
    ),
    ("experiments", EXPERIMENT, "instances"): (
        {"fixed": {**INSTANCE, "sensor_noise": 0.07}},
        {"pair", "job", "explanation"},
    ),
    ("experiments", EXPERIMENT, "replicates"): (2, {"job"}),
    ("experiments", EXPERIMENT, "figures"): (["interactions"], set()),
    ("experiments", EXPERIMENT, "waterfall"): (INSTANCE, set()),
    ("experiments", EXPERIMENT, "dependence"): ([["sensor_noise", "initial_pose"]], set()),
    ("experiments", EXPERIMENT, "what_if"): ({"closer": {"initial_pose": 1.1}}, set()),
    ("experiments", EXPERIMENT, "scenes"): (
        [{"sequence": "own", "reference": 0, "source": 1}],
        set(),
    ),
}
# Keys that the campaign's configuration cannot change alone.
ELSEWHERE = {
    ("data", "archive"): "no archive is fetched",
    ("data", "speed"): "the tilting laser has none",
    ("data", "guess"): "it goes with `poses: register`",
    ("estimators", "kind"): "there is one kind",
    ("estimators", "sensor_sigma"): "by draws it needs ten of them",
    ("experiments", "estimators"): "it makes other experiments",
    ("estimators", "based_on"): "what is inherited changes with the options",
    ("experiments", "based_on"): "what is inherited changes with the keys",
}
VALUES = {
    "runs": 80,
    "maximum_distance": 2.0,
    "voxel_size": 0.1,
    "normal_radius": 0.2,
    "maximum_iterations": 7,
    "noise_draws": 2,
    "reference_noise_additions": 2,
    "common_random_numbers": False,
    "kept_links": 0.8,
    "subsampling_probability": 0.3,
    "bias_correction": "jackknife",
}
# A pair of options of which one alone changes no number of these scans; the plan knows no better.
METHOD = set(options.names(Method))


def edits():
    """Path to (another value, steps that it decides) of every key."""
    found = dict(EDITS)
    for name in sorted(presets.option_names(presets.DEFAULT_KIND)):
        if ("estimators", name) in ELSEWHERE:
            continue
        steps = {"explanation"} if name in METHOD else {"pair", "job"}
        for cause in CAUSES.values():
            if name in options.names(cause):
                named = cause.name in INSTANCE
                steps = {"pair", "job", "explanation"} if named else set()
        found[(*TINY, name)] = (other_value(name), steps)
    return found


def other_value(name):
    """Another valid value of an option of an estimator."""
    if name in VALUES:
        return VALUES[name]
    rule = schema.estimator("monte_carlo")["properties"][name]
    present = presets.PAPER.options[name]
    if "enum" in rule:
        return next(value for value in rule["enum"] if value != present)
    if isinstance(present, bool):
        return not present
    return present + 1 if isinstance(present, int) else present * 1.5 or 0.1


def keys_of_schema():
    """Path of every key that the schema knows, with the names of the campaign's blocks."""
    rules = schema.configuration()["properties"]
    blocks = {"data": None, "estimators": "tiny", "experiments": EXPERIMENT, "perturbation": None}
    for key in rules:
        if key not in blocks:
            yield (key,)
    yield from (("perturbation", name) for name in rules["perturbation"]["properties"])
    # The estimator of the campaign is of this kind.
    for name in schema.estimator(presets.DEFAULT_KIND)["properties"]:
        yield "estimators", "tiny", name
    for name in rules["experiments"]["additionalProperties"]["properties"]:
        yield "experiments", EXPERIMENT, name
    for name, rule in rules["data"]["additionalProperties"]["properties"].items():
        sequence = ROOM if name in ("simulated", "scans") else SEQUENCE
        for inner in rule.get("properties", {"": None}) if name != "archive" else [""]:
            yield ("data", sequence, name, inner) if inner else ("data", sequence, name)


def faults(folder, config, short):
    """A fault for every key, and for each that decides numbers the question to the numbers."""
    folder = Path(folder)
    known = edits()
    for path in keys_of_schema():
        if (path[0], path[-1]) in ELSEWHERE:
            continue
        yield Fault(f"{'.'.join(path)}: another value", partial(_edited, folder, config, path))
    with in_process.inside(folder):
        before = _numbers(folder, config)
    for path, (value, _) in known.items():
        if path[0] in ("seed", "perturbation", "estimators") and (not short or path[-1] in SAMPLE):
            attempt = partial(_asked, folder, config, path, value, before)
            yield Fault(f"{'.'.join(path)}: the numbers that follow from it", attempt)


SAMPLE = ("seed", "minimum_range", "divergence")


def edited(config, path, value):
    """A copy of a configuration with one value set."""
    config = copy.deepcopy(config)
    block = config
    for key in path[:-1]:
        block = block.setdefault(key, {})
    block[path[-1]] = value
    if path[-1] == "pairs":
        del block["sequences"]  # a list of pairs names its own
    return config


def _edited(folder, config, path):
    """Exactly the plans that should be others are."""
    if path not in edits():
        return Outcome("wrong", "nothing is known of what this key decides")
    value, steps = edits()[path]
    expected = set().union(steps, *(AFTER[step] for step in steps)) - {"cut"}
    with in_process.inside(folder):
        before, after = (_digests(of) for of in (config, edited(config, path, value)))
    found = {step for step in STEPS if before[step] != after[step]}
    if found == expected:
        return RIGHT
    missed, needless = sorted(expected - found), sorted(found - expected)
    return Outcome("wrong", f"plans not changed: {missed}; changed needlessly: {needless}")


def _digests(config):
    """Digests of the plans of every step, of one pair, job or sequence."""
    found = in_process.planner(config)
    pair = found.config.experiments[EXPERIMENT].pairs[SEQUENCE][0]
    return {
        "scan": digest(found.scan(SEQUENCE, 0)),
        "simulated": digest(found.scan(ROOM, 0)),
        "poses": digest(found.poses(SEQUENCE)),
        "overlap": digest(found.overlap(SEQUENCE, pair)),
        "pair": digest(found.checks(EXPERIMENT, SEQUENCE, 0)),
        "job": digest(found.job(EXPERIMENT, SEQUENCE, 0)),
        "explanation": digest(found.explanation(EXPERIMENT, SEQUENCE)),
        "joined": digest(found.joined(EXPERIMENT)),
    }


def _numbers(folder, config):
    """Runs of a job, and the Shapley values of a sequence, with the digests of their plans."""
    found = in_process.planner(config)
    output = folder / "asked"
    output.mkdir(exist_ok=True)
    in_process.register(found, EXPERIMENT, SEQUENCE, 0, output / "runs.parquet")
    return storage.read(output / "runs.parquet")[0], digest(found.job(EXPERIMENT, SEQUENCE, 0))


def _asked(folder, config, path, value, before):
    """Where the numbers are others, the plan is."""
    with in_process.inside(folder):
        if path[-1] in METHOD:
            return _explained(folder, config, path, value)
        after = _numbers(folder, edited(config, path, value))
    if before[0].equals(after[0]) or before[1] != after[1]:
        return RIGHT
    return Outcome("wrong", "other runs, and the same plan")


def _explained(folder, config, path, value):
    """The same of the explanation, whose runs stay."""
    made = []
    for of in (config, edited(config, path, value)):
        found = in_process.planner(of)
        in_process.explain(found, EXPERIMENT, SEQUENCE, folder / "asked")
        tables = [storage.read(folder / "asked" / f"{name}.parquet")[0] for name in ("shap",)]
        made.append((tables, digest(found.explanation(EXPERIMENT, SEQUENCE))))
    (tables, plan), (others, other_plan) = made
    if plan != other_plan or all(a.equals(b) for a, b in zip(tables, others, strict=True)):
        return RIGHT
    return Outcome("wrong", "other values, and the same plan")


# Of each kind of decision one, through Snakemake's own eyes.
DRY_RUNS = (
    ("perturbation", "overlap_distance"),
    ("perturbation", "minimum_overlap"),
    (*TINY, "minimum_range"),
    (*TINY, "divergence"),
    (*TINY, "maximum_iterations"),
    ("data", SEQUENCE, "drop_non_finite"),
    ("data", ROOM, "simulated", "beams"),
    ("data", SEQUENCE, "title"),
    ("seed",),
)


# Rules that a dry run plans besides: with some files of poses scans are read, as the key says.
BESIDES = {("data", SEQUENCE, "drop_non_finite"): {"read_poses"}}


def dry_runs(place, short):
    """The rules that a dry run plans after an edit."""
    for path in DRY_RUNS[: 2 if short else None]:
        yield Fault(f"{'.'.join(path)}: the rules of a dry run", partial(_planned, place, path))


def _planned(place, path):
    config = place.config()
    value, steps = edits()[path]
    followed = set().union(steps, *(AFTER[step] for step in steps))
    expected = {RULES[step] for step in followed & set(RULES)}
    if "simulate_scans" in expected:
        # The other experiment has the simulated scene.
        expected |= {RULES[step] for step in AFTER["scan"] & set(RULES)}
    expected |= BESIDES.get(path, set())
    place.configure(edited(config, path, value))
    try:
        code, said = place.run("-n", "--", *TABLES)
    finally:
        (place.folder / CONFIG).write_text(yaml.safe_dump(config, sort_keys=False))
    # Jobs of few pairs or settings have a rule of their own.
    names = {rule: (rule, few.RULES.get(rule, rule)) for rule in RULES.values()}
    found = {rule for rule in names if any(f"\n{name} " in said for name in names[rule])}
    if code == 0 and found == expected:
        return RIGHT
    return Outcome("wrong", f"planned {sorted(found)}, expected {sorted(expected)}")
