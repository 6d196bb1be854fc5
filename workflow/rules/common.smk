"""Settings of the workflow, and the questions that rules ask of them."""

from dataclasses import asdict

from icpshap import plan, provenance, settings

try:
    SETTINGS = settings.load(config)
except settings.SettingsError as error:
    raise WorkflowError(str(error)) from None

# Jobs are parallel by processes; a library that starts threads of its own only gets in their way.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[variable] = "1"
os.environ.setdefault("NUMBA_CACHE_DIR", os.path.abspath(".cache/numba"))
os.environ.setdefault("MPLCONFIGDIR", os.path.abspath(".cache/matplotlib"))


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


def selected_sequences(experiment):
    """The sequences of an experiment that are selected, in the experiment's order."""
    return [key for key in experiment.pairs if key in SETTINGS.sequences]


def scopes(experiment):
    """The whole experiment when all of its sequences are selected, else each selected sequence."""
    selected = selected_sequences(experiment)
    if len(selected) == len(experiment.pairs):
        return [experiment.name]
    return [f"{experiment.name}/{key}" for key in selected]


def targets():
    """The files of every selected experiment that has a selected sequence."""
    paths = []
    for name in SETTINGS.run:
        experiment = SETTINGS.experiments[name]
        if not selected_sequences(experiment):
            known = ", ".join(experiment.pairs)
            logger.info(f"Skipping {name}: none of its sequences ({known}) is selected.")
        for scope in scopes(experiment):
            paths += [f"results/{scope}/uncertainty.parquet", f"results/{scope}/shap.parquet"]
            paths += figures_of(experiment, scope)
            paths += tables_of(scope)
    return paths
