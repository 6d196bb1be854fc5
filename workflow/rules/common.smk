"""Settings of the workflow, and the questions that rules ask of them."""

import csv
import time
from dataclasses import asdict

from icpshap import config as settings, plan
from icpshap.data import citation
from icpshap.jobs import digests as provenance, provenance as record
from icpshap.data.scans import DataError, find_folder_files
from icpshap.causes import NAMES

try:
    SETTINGS = settings.load(config)
except settings.SettingsError as error:
    raise WorkflowError(str(error)) from None

STARTED = time.time()

# Scan files and pose file of each folder, known without reading them; a missing one is said here,
# since an error of an input function comes with a traceback.
FOLDER_FILES = {}
for key in SETTINGS.sequences:
    sequence = SETTINGS.data[key]
    if sequence.kind == "folder":
        try:
            FOLDER_FILES[key] = find_folder_files(
                sequence.folder["path"], sequence.scans, sequence.folder.get("poses")
            )
        except DataError as error:
            raise WorkflowError(f"data.{key}: {error}") from None

# Jobs are parallel by processes; a library that starts threads of its own only gets in their way.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ.setdefault("NUMBA_CACHE_DIR", f"{workflow.basedir}/.cache/numba")
os.environ.setdefault("MPLCONFIGDIR", f"{workflow.basedir}/.cache/matplotlib")
# Figures are drawn into files; no window may open.
os.environ.setdefault("MPLBACKEND", "Agg")


def keys_of_kind(kind):
    """Regular expression of the sequences that are an archive, a folder or simulated."""
    keys = [key for key, sequence in SETTINGS.data.items() if sequence.kind == kind]
    return "|".join(keys) or "(?!)"


wildcard_constraints:
    sequence="[a-z][a-z0-9_]*",
    experiment="[a-z][a-z0-9_]*",
    # An experiment, or one sequence of it.
    scope="[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)?",
    index=r"\d+",
    reference=r"\d+",
    source=r"\d+",
    chunk=r"\d+",


def code_digest(rule):
    """Digest of the library modules that a rule's script imports: editing them runs it again."""
    return provenance.code_digest(f"{workflow.basedir}/workflow/scripts/{rule}.py")


def sequence_of(wildcards):
    return SETTINGS.data[wildcards.sequence]


def experiment_of(wildcards):
    return SETTINGS.experiments[wildcards.experiment]


def estimator_of(wildcards):
    return SETTINGS.estimators[experiment_of(wildcards).estimator]


def pairs_of(wildcards):
    return experiment_of(wildcards).pairs[wildcards.sequence]


def jobs_of(wildcards):
    """The settings of each job of a pair, in the order of the chunks."""
    experiment = experiment_of(wildcards)
    return plan.jobs(
        experiment.levels,
        experiment.replicates,
        estimator_of(wildcards).runs,
        SETTINGS.runs_per_job,
    )


def local_archive(wildcards):
    return sequence_of(wildcards).archive.get("path", [])


def checks_of_pairs(wildcards):
    return [
        f"results/{wildcards.experiment}/{wildcards.sequence}/pairs/{reference}-{source}.parquet"
        for reference, source in pairs_of(wildcards)
    ]


def runs_of_pairs(wildcards):
    chunks = len(jobs_of(wildcards))
    return [
        f"results/{wildcards.experiment}/{wildcards.sequence}/runs/{i}-{j}/{chunk}.parquet"
        for i, j in pairs_of(wildcards)
        for chunk in range(chunks)
    ]


def selected_sequences(experiment):
    """The sequences of an experiment that are selected, in the experiment's order."""
    return [key for key in experiment.pairs if key in SETTINGS.sequences]


def scopes(experiment):
    """The whole experiment when all of its sequences are selected, else each selected sequence."""
    selected = selected_sequences(experiment)
    if len(selected) == len(experiment.pairs):
        return [experiment.name]
    return [f"{experiment.name}/{key}" for key in selected]


FIGURES = {
    "summary": ["summary"],
    "waterfall": ["waterfall"],
    "dependence": [
        "dependence_sensor_noise_by_initial_pose",
        "dependence_initial_pose_by_partial_overlap",
        "dependence_partial_overlap_by_initial_pose",
    ],
    "interactions": ["interactions"],
    "pairs": ["pairs"],
}


def study_of(wildcards):
    """How the numbers of a scope came about, as far as figures and captions say it."""
    name = wildcards.get("experiment") or wildcards["scope"].split("/")[0]
    experiment = SETTINGS.experiments[name]
    estimator = SETTINGS.estimators[experiment.estimator]
    return {
        "name": experiment.name,
        "estimator": experiment.estimator,
        "divergence": estimator.divergence,
        "noise_draws": estimator.noise_draws,
        "bias_correction": estimator.bias_correction,
        "wrong_basins": estimator.wrong_basins,
        "titles": {key: SETTINGS.data[key].title for key in experiment.pairs},
        "waterfall": experiment.waterfall,
    }


def figures_of(experiment, scope):
    """Pictures of an experiment, or of one sequence of it."""
    names = [name for family in experiment.figures for name in FIGURES[family]]
    figures = [f"results/{scope}/figures/{name}.png" for name in names]
    return figures + [
        f"results/{experiment.name}/{sequence}/figures/scene_{reference}-{source}.{kind}"
        for sequence, pairs in experiment.scenes.items()
        if scope in (experiment.name, f"{experiment.name}/{sequence}")
        for reference, source in pairs
        for kind in ("png", "html")
    ]


def runs_of_scene(wildcards):
    folder = f"results/{wildcards.experiment}/{wildcards.sequence}/runs"
    pair = f"{wildcards.reference}-{wildcards.source}"
    return [f"{folder}/{pair}/{chunk}.parquet" for chunk in range(len(jobs_of(wildcards)))]


def perturbation_of_scene(wildcards):
    """The instance of the waterfall plot, or every source at its largest level."""
    experiment = experiment_of(wildcards)
    return experiment.waterfall or {name: max(experiment.levels[name]) for name in NAMES}


def rankings_of(experiment, scope):
    """Medians are of pairs; over the perturbations of a grid they would mean little."""
    if any(len(levels) > 1 for levels in experiment.levels.values()):
        return []
    return [f"results/{scope}/tables/outlier_rules.csv"]


def selected_scopes():
    """Experiment and scope of all that is selected."""
    experiments = [SETTINGS.experiments[name] for name in SETTINGS.run]
    return [(experiment, scope) for experiment in experiments for scope in scopes(experiment)]


def sections():
    """What report and comparison read of each selected scope."""
    return [
        {
            "scope": scope,
            "study": study_of({"experiment": experiment.name}),
            "figures": [
                path.replace(".png", ".svg")
                for path in figures_of(experiment, scope)
                if path.endswith(".png")
            ],
            "rankings": rankings_of(experiment, scope),
        }
        for experiment, scope in selected_scopes()
    ]


def compared_sections():
    """The sections with a sequence that the paper has values of."""
    with open(f"{workflow.basedir}/reference/table1.csv") as table:
        known = {row["sequence"] for row in csv.DictReader(table)}
    return [section for section in sections() if known & set(section["study"]["titles"])]


def files_of(sections, *tables):
    """The tables, rankings and pictures of sections."""
    return [
        path
        for section in sections
        for path in [
            *(f"results/{section['scope']}/{table}.parquet" for table in tables),
            *section["rankings"],
            *section["figures"],
        ]
    ]


def titles():
    return {key: sequence.title for key, sequence in SETTINGS.data.items()}


def targets():
    """The files of every selected experiment that has a selected sequence."""
    for name in SETTINGS.run:
        if not selected_sequences(SETTINGS.experiments[name]):
            known = ", ".join(SETTINGS.experiments[name].pairs)
            logger.info(f"Skipping {name}: none of its sequences ({known}) is selected.")
    paths = [
        path for experiment, scope in selected_scopes() for path in figures_of(experiment, scope)
    ]
    paths += files_of(sections(), "uncertainty", "shap")
    if not paths:
        raise WorkflowError(
            f"None of the experiments {', '.join(SETTINGS.run)} has a pair in the sequences "
            f"{', '.join(SETTINGS.sequences)}.\nHint: select others with `run` or `sequences`."
        )
    return [*paths, "results/report.html", "results/provenance.yaml"]
