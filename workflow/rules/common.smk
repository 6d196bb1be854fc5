"""The configuration, and the questions that rules ask of it."""

import csv
import re
import sys
import time
from dataclasses import asdict
from functools import cache

import yaml
from snakemake.cli import get_argument_parser
from snakemake.sourcecache import LocalSourceFile
from snakemake.utils import update_config

RULES = workflow.current_basedir


def source(path):
    """A file of this workflow, wherever that is taken from: of a hosted one, Snakemake's copy."""
    file = RULES.join(f"../../{path}")
    if isinstance(file, LocalSourceFile):
        return os.path.abspath(file.get_path_or_uri(secret_free=True))
    return str(workflow.sourcecache.get_path(file))


ROOT = os.path.dirname(source("config.yaml"))
# As a module of another workflow, this is not where Python looks for the library.
IS_MODULE = workflow.modifier.is_module and not workflow.modifier.is_main_snakefile()
if IS_MODULE and os.path.isdir(f"{ROOT}/icpshap"):
    sys.path.insert(0, ROOT)
    known = os.environ.get("PYTHONPATH")
    os.environ.update(PYTHONPATH=os.pathsep.join(filter(None, [ROOT, known])))

from icpshap import config as configuration, options, selection, storage
from icpshap.data import citation
from icpshap.data.folder import find_files
from icpshap.errors import DataError, UserError
from icpshap.jobs import digests, few, parents, paths, progress, start, time_limits
from icpshap.jobs.plans import Plans, is_settled
from icpshap.jobs.paths import at
from icpshap.jobs.provenance import commit
from icpshap.report.study import Study

WHOLE_CONFIG = config
if IS_MODULE:
    # Its block of configuration is laid over the paper's, as a file of a user's own is.
    with open(source("config.yaml"), encoding="utf-8") as file:
        WHOLE_CONFIG = yaml.safe_load(file)
    update_config(WHOLE_CONFIG, config)

try:
    for path in workflow.configfiles:
        configuration.check_file(path)
    CONFIG = configuration.load(WHOLE_CONFIG)
except configuration.ConfigError as error:
    raise WorkflowError(str(error)) from None

STARTED = time.time()


def is_so_far(arguments):
    """Whether a command line asks for the report on the run of another Snakemake, and no more.

    By the rule, also under the name that a module gives it, or by its folder; a value of an option,
    such as of --directory or --forcerun, is no target.
    """
    if not any("so_far" in word for word in arguments):
        return False
    targets = get_argument_parser().parse_known_args(arguments)[0].targets
    return bool(targets) and all(os.path.normpath(t).endswith("so_far") for t in targets)


# Before the workflow is set up, only the command line tells what this is going to be.
IS_RUN = start.is_run(sys.argv[1:])
IS_SO_FAR = is_so_far(sys.argv[1:])

if IS_RUN:
    try:
        start.check_folders()
    except UserError as error:
        raise WorkflowError(str(error)) from None

for key in CONFIG.sequences:
    archive = CONFIG.data[key].archive or {}
    if "path" in archive and not os.path.isfile(archive["path"]):
        raise WorkflowError(
            f"data.{key}.archive: {archive['path']}: no such file.\n"
            "Hint: the path is relative to the working directory; `url` fetches from the server."
        )

# Scan files and pose file of each folder, known without reading them; a missing one is said here,
# since an error of an input function comes with a traceback.
FOLDER_FILES = {}
for key in CONFIG.sequences:
    sequence = CONFIG.data[key]
    if sequence.kind == "folder":
        try:
            FOLDER_FILES[key] = find_files(sequence.folder, sequence.scans)
        except DataError as error:
            raise WorkflowError(f"data.{key}: {error}") from None

PLANS = Plans(
    CONFIG,
    FOLDER_FILES,
    lambda script, *plugins: digests.code_digest(source(f"workflow/scripts/{script}.py"), plugins),
)

# By rule, the sequences of which its jobs take seconds, and are those of a local rule. But one that
# the command line names makes all of its files, so that --forcerun, --until and such mean them all.
NAMED = set(re.findall(r"\w+", " ".join(sys.argv[1:])))
FEW = {
    name: [] if workflow.modifier.modify_rulename(name) in NAMED else sequences
    for name, sequences in few.few(PLANS).items()
}

# Jobs are parallel by processes; a library that starts threads of its own only gets in their way.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[variable] = "1"
# All folders that use a clone share its caches, unless it can only be read.
CACHES = f"{ROOT if os.access(ROOT, os.W_OK) else os.getcwd()}/.cache"
os.environ.setdefault("NUMBA_CACHE_DIR", f"{CACHES}/numba")
os.environ.setdefault("MPLCONFIGDIR", f"{CACHES}/matplotlib")
# Figures are drawn into files; no window may open.
os.environ.setdefault("MPLBACKEND", "Agg")


def keys_of_kind(kind):
    """Regular expression of the sequences that are an archive, a folder or simulated."""
    keys = [key for key, sequence in CONFIG.data.items() if sequence.kind == kind]
    return "|".join(keys) or "(?!)"


def keys_of_folders(registers):
    """Regular expression of the folders of which ICP makes the poses, or of the others."""
    keys = [
        key
        for key, sequence in CONFIG.data.items()
        if sequence.kind == "folder" and sequence.registers == registers
    ]
    return "|".join(keys) or "(?!)"


def experiments_that_return(samples, covariances):
    """Regular expression of the experiments whose estimator returns just this."""
    names = [
        name
        for name, experiment in CONFIG.experiments.items()
        for returns in [CONFIG.preset(name).estimator.returned]
        if (returns.samples, returns.covariances) == (samples, covariances)
    ]
    return "|".join(names) or "(?!)"


def before_few(rule):
    """Regular expression of {experiment} before a {sequence} of which a job of a rule is short."""
    known = "|".join(FEW[rule]) or "(?!)"
    return f"(?=(?:{known})/)[a-z][a-z0-9_]*"


def before_many(rule):
    """The same before any other {sequence}."""
    return before_few(rule).replace("(?=", "(?!", 1)


wildcard_constraints:
    sequence="[a-z][a-z0-9_]*",
    experiment="[a-z][a-z0-9_]*",
    # An experiment, or one sequence of it.
    scope="[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)?",
    batch=r"\d+",
    reference=r"\d+",
    source=r"\d+",
    job=r"\d+",


# --- what a job is about ---------------------------------------------------------------------------


def sequence_of(wildcards):
    return CONFIG.data[wildcards.sequence]


def experiment_of(wildcards):
    """The experiment of a job, by its wildcard {experiment} or {scope}."""
    name = wildcards.get("experiment") or wildcards["scope"].split("/")[0]
    return CONFIG.experiments[name]


def preset_of(wildcards):
    return CONFIG.preset(experiment_of(wildcards).name)


def estimator_of(wildcards):
    """The estimator with the causes that the experiment names."""
    return preset_of(wildcards).estimator.of_causes(experiment_of(wildcards).causes)


def returns_of(wildcards):
    return estimator_of(wildcards).returned


def method_of(wildcards):
    return options.values(preset_of(wildcards).method)


def pairs_of(wildcards):
    return experiment_of(wildcards).pairs[wildcards.sequence]


def jobs_of(wildcards):
    """The parts of each job of a sequence."""
    return PLANS.jobs(wildcards.experiment, wildcards.sequence)


def parts_of(wildcards):
    """The parts of one job."""
    return jobs_of(wildcards)[int(wildcards.job)]


def is_here(wildcards):
    """Whether the instances of an experiment are diagnosed, and played on other pairs."""
    return bool(experiment_of(wildcards).measured)


def pairs_of_job(wildcards):
    """The pairs that a job reads: those of its parts, or all that they may be played on."""
    found = [part.pair for part in parts_of(wildcards)]
    if not is_here(wildcards):
        return found
    known = pairs_of(wildcards)
    first, last = (known.index(pair) for pair in (found[0], found[-1]))
    return PLANS.pairs_beside(wildcards.experiment, wildcards.sequence, range(first, last + 1))


def pairs_of_batch(wildcards):
    """The pairs of a job that measures and checks them."""
    return PLANS.batches(wildcards.experiment, wildcards.sequence)[int(wildcards.batch)]


def pairs_beside(wildcards):
    """The pairs that a job reads which diagnoses some: also those that these are held against."""
    names = wildcards.experiment, wildcards.sequence
    return PLANS.pairs_beside(*names, PLANS.diagnosis_batches(*names)[int(wildcards.batch)])


def pairs_of_registrations(wildcards):
    """The pairs of a job that makes poses by registering them."""
    references = PLANS.registration_batches(wildcards.sequence)[int(wildcards.batch)]
    return [(index, index + 1) for index in references]


def pair_of_scene(wildcards):
    return [(int(wildcards.reference), int(wildcards.source))]


def indices_of_scans(wildcards):
    """The scans of a file of them."""
    return PLANS.scan_batches(wildcards.sequence)[int(wildcards.batch)]


def code(rule):
    """Digest of the library modules that a rule's script imports: editing them runs it again."""
    return digests.code_digest(source(f"workflow/scripts/{rule}.py"))


def code_of_experiment(rule):
    """The same with the causes and the estimator of the job's experiment, and no others."""
    script = source(f"workflow/scripts/{rule}.py")
    return lambda wildcards: digests.code_digest(script, estimator_of(wildcards).plugins)


def plugins_of(wildcards):
    """Names of the causes and the estimator of a job's experiment."""
    return digests.plugin_names(estimator_of(wildcards))


# --- files -----------------------------------------------------------------------------------------


def scans_for(pairs_of):
    """Input function: the files of the scans of pairs_of(wildcards)."""

    def files(wildcards):
        indices = {index for pair in pairs_of(wildcards) for index in pair}
        found = sorted({PLANS.file_of_scan(wildcards.sequence, index) for index in indices})
        return [at(paths.SCANS, sequence=wildcards.sequence, batch=batch) for batch in found]

    return files


def checks_for(template, pairs_of):
    """Input function: the files that tell of each of pairs_of(wildcards) what a check found."""

    def files(wildcards):
        names = {"experiment": wildcards.experiment, "sequence": wildcards.sequence}
        batch_of = PLANS.batch_of(**names)
        found = sorted({batch_of[pair] for pair in pairs_of(wildcards)})
        return [at(template, **names, batch=batch) for batch in found]

    return files


def local_archive(wildcards):
    return sequence_of(wildcards).archive.get("path", [])


def of_old(template, plan, files):
    """Input function: files(wildcards), but for a file that is there and has its plan as `ancient`.

    A plan says all that decides a file. What else is made anew with its inputs, such as the scans
    of other pairs in one file with its own, or the checks of pairs for another smallest overlap,
    is no reason to make it again.
    """

    def inputs(wildcards):
        made = template(wildcards) if callable(template) else template
        made = at(made, **dict(wildcards.items()))
        found = files(wildcards)
        if not os.path.exists(made) or not is_settled(made, plan(wildcards)):
            return found
        return ancient(found) if isinstance(found, str) else [ancient(file) for file in found]

    return inputs


def scan_names(wildcards):
    """Paths of the scans of a folder below it, which may say which poses are theirs."""
    folder = sequence_of(wildcards).folder["path"]
    scans, _ = FOLDER_FILES[wildcards.sequence]
    return [os.path.relpath(path, folder) for path in scans]


def files_of_scans(wildcards):
    """The scan files of a folder that a job reads."""
    files, _ = FOLDER_FILES[wildcards.sequence]
    return [files[index] for index in indices_of_scans(wildcards)]


def memory_of_files(wildcards, input, attempt):
    """Resource mem_mb of reading the scan files of a folder one by one."""
    return attempt * (300 + round(10 * max(map(os.path.getsize, input)) / 1e6))


def time_of_files(wildcards, input, attempt):
    """Resource runtime of reading the scan files of a folder.

    0.02 s for each megabyte of text, twice what was measured (5.8 MB of CSV in 0.03 s), since the
    table is written besides; binary files are faster.
    """
    return time_limits.minutes(0.02 * sum(map(os.path.getsize, input)) / 1e6, attempt)


def memory_of_poses(wildcards):
    """Resource mem_mb of reading poses, which may ask two scans where quaternions have qw."""
    return 500 + round(20 * max(map(os.path.getsize, FOLDER_FILES[wildcards.sequence][0])) / 1e6)


def registrations_of(wildcards):
    """The registrations of the consecutive scans of a sequence."""
    batches = range(len(PLANS.registration_batches(wildcards.sequence)))
    return [at(paths.REGISTRATIONS, sequence=wildcards.sequence, batch=k) for k in batches]


def poses_of(wildcards):
    return at(paths.POSES, sequence=wildcards.sequence)


def plan_of_scans(wildcards):
    return PLANS.scans(wildcards.sequence, int(wildcards.batch))


def plan_of_checks(wildcards):
    return PLANS.checks(wildcards.experiment, wildcards.sequence, int(wildcards.batch))


def plan_of_diagnosis(wildcards):
    names = wildcards.experiment, wildcards.sequence
    return PLANS.diagnosis_of_batch(*names, int(wildcards.batch))


def plan_of_instances(wildcards):
    names = wildcards.experiment, wildcards.sequence
    return PLANS.instances_of_batch(*names, int(wildcards.batch))


def files_of_batches(wildcards):
    """What jobs found of some pairs each, for a table of all pairs: diagnosis or instances."""
    batches = range(len(PLANS.diagnosis_batches(wildcards.experiment, wildcards.sequence)))
    return [at(paths.OF_BATCH, **dict(wildcards.items()), batch=batch) for batch in batches]


def plan_of_joined_pairs(wildcards):
    _, of_all = PLANS.of_diagnosis[wildcards.table]
    return of_all(wildcards.experiment, wildcards.sequence)


def digests_of_batches(wildcards):
    return PLANS.batch_digests(wildcards.experiment, wildcards.sequence, wildcards.table)


def instances_of(wildcards):
    """What is played of each pair, where instances are diagnosed."""
    return [at(paths.INSTANCES, **dict(wildcards.items()))] if is_here(wildcards) else []


def plan_of_job(wildcards):
    return PLANS.job(wildcards.experiment, wildcards.sequence, int(wildcards.job))


def estimates_template(wildcards):
    return paths.RUNS if returns_of(wildcards).samples else paths.ESTIMATES


def descriptors_of_job(wildcards):
    """What the estimator of a job learns from: the other sequences of another experiment."""
    experiment, sequence = wildcards.experiment, wildcards.sequence
    training = PLANS.training(experiment)
    return [
        at(paths.DESCRIPTORS, experiment=training, sequence=other)
        for other in PLANS.training_sequences(experiment, sequence)
    ]


def of_jobs(template, wildcards, jobs):
    values = {"experiment": wildcards.experiment, "sequence": wildcards.sequence}
    return [at(template, **values, job=job) for job in jobs]


def runs_of_sequence(wildcards):
    jobs = range(len(jobs_of(wildcards)))
    return of_jobs(paths.RUNS, wildcards, jobs) if returns_of(wildcards).samples else []


def estimates_of_sequence(wildcards):
    jobs = range(len(jobs_of(wildcards)))
    return of_jobs(paths.ESTIMATES, wildcards, jobs) if returns_of(wildcards).covariances else []


def runs_of_scene(wildcards):
    """The runs of the jobs that hold a pair's settings."""
    pair = (int(wildcards.reference), int(wildcards.source))
    jobs = [
        number
        for number, parts in enumerate(jobs_of(wildcards))
        if any(part.pair == pair for part in parts)
    ]
    return of_jobs(paths.RUNS, wildcards, jobs) if returns_of(wildcards).samples else []


def memory_of_scans(base, per_million):
    """Resource mem_mb of a rule that reads scans, told when they are there.

    base, per_million: megabytes, and those for each million points of the larger scan; measured
    by `python -m benchmarks.memory`.
    """

    def mem_mb(wildcards, input, attempt):
        return attempt * (base + round(per_million * largest_scan(input) / 1e6))

    return mem_mb


def largest_scan(input):
    """Points of the largest scan that a job reads."""
    return max(storage.largest_part(path) for path in input.scans)


def time_of_scans(pairs_of, seconds):
    """Resource runtime of a rule that takes so many seconds for each of pairs_of(wildcards).

    seconds: for scans of a million points.
    """

    def runtime(wildcards, input, attempt):
        each = seconds * largest_scan(input) / 1e6
        return time_limits.minutes(len(pairs_of(wildcards)) * each, attempt)

    return runtime


def time_of_registrations(wildcards, input, attempt):
    """Resource runtime of the settings of a job."""
    settings = sum(part.stop - part.start for part in parts_of(wildcards))
    work = estimator_of(wildcards), settings, largest_scan(input)
    return time_limits.minutes(time_limits.seconds_of_settings(*work), attempt)


def time_of_diagnosis(wildcards, input, attempt):
    """Resource runtime of diagnosing some pairs of a sequence."""
    work = len(pairs_beside(wildcards)), largest_scan(input)
    return time_limits.minutes(time_limits.seconds_of_diagnosis(*work), attempt)


def settings_of(wildcards):
    """Number of the settings of all pairs of a sequence."""
    return sum(part.stop - part.start for parts in jobs_of(wildcards) for part in parts)


def time_of_explanation(wildcards, attempt):
    """Resource runtime of explaining a sequence."""
    runs, interval = estimator_of(wildcards).number_of_runs, method_of(wildcards)["interval"]
    work = settings_of(wildcards), runs, interval
    return time_limits.minutes(time_limits.seconds_of_explanation(*work), attempt)


def time_of_training(wildcards, input, attempt):
    """Resource runtime of describing the settings of a sequence: each has normals of two scans."""
    millions = settings_of(wildcards) * largest_scan(input) / 1e6
    return time_limits.minutes(2 * time_limits.OF_REFERENCE * millions, attempt)


def growing(amount):
    """A resource of which a job that ran out of it, or was killed, gets as much more each time."""
    return lambda wildcards, attempt: attempt * amount


def tables_of_sequences(table):
    """Input function: a table of each sequence of an experiment."""
    return lambda wildcards: [
        at(paths.OF_SEQUENCE, experiment=wildcards.experiment, sequence=sequence, table=table)
        for sequence in experiment_of(wildcards).pairs
    ]


def shap_of_scope(wildcards):
    return at(paths.TABLE, scope=wildcards.scope, table="shap")


# --- what is shown ---------------------------------------------------------------------------------


def selected_sequences(experiment):
    """The sequences of an experiment that are selected, in the experiment's order."""
    return [key for key in experiment.pairs if key in CONFIG.sequences]


def scopes(experiment):
    """The whole experiment when all of its sequences are selected, else each selected sequence."""
    selected = selected_sequences(experiment)
    if selected and len(selected) == len(experiment.pairs):
        return [experiment.name]
    return [f"{experiment.name}/{key}" for key in selected]


def figure_names(experiment):
    """Names of the figures of an experiment, one for each couple of a dependence plot."""
    names = []
    for figure in experiment.figures:
        if figure == "dependence":
            names += [f"dependence_{a}_by_{b}" for a, b in experiment.dependence]
        elif figure != "drive":  # which is of one sequence
            names.append(figure)
    return names


def study_of(wildcards):
    """How the numbers of a scope came about, as far as figures and captions say it."""
    experiment = experiment_of(wildcards)
    return asdict(
        Study.of(
            experiment.name,
            experiment.estimator,
            preset_of(wildcards),
            experiment.causes,
            dependence=experiment.dependence,
            titles={key: CONFIG.data[key].title for key in experiment.pairs},
            waterfall=experiment.waterfall,
            here=bool(experiment.measured),
        )
    )


def perturbation_of_scene(wildcards):
    """The instance of the waterfall plot, or every cause at its largest level."""
    experiment = experiment_of(wildcards)
    return experiment.waterfall or {name: max(levels) for name, levels in experiment.levels.items()}


def figures_of(experiment, scope, kind):
    """Pictures of an experiment, or of one sequence of it, as files of a kind."""
    figures = [
        at(paths.FIGURE, scope=scope, figure=name, kind=kind) for name in figure_names(experiment)
    ]
    first = diagnosis_figures(experiment, scope, kind) + drives_of(experiment, scope, kind)
    return first + figures + scenes_of(experiment, scope, kind)


def sequences_of(experiment, scope):
    """The sequences of an experiment that a scope of it holds."""
    return [
        key for key in experiment.pairs if scope in (experiment.name, f"{experiment.name}/{key}")
    ]


def diagnoses_of(experiment, scope):
    """The diagnoses of the sequences of a scope."""
    return [
        at(paths.DIAGNOSIS, experiment=experiment.name, sequence=sequence)
        for sequence in sequences_of(experiment, scope)
    ]


def diagnosis_figures(experiment, scope, kind):
    """Their pictures as files of a kind; of a single pair, which is held against none, none."""
    return [
        at(paths.DIAGNOSIS_FIGURE, experiment=experiment.name, sequence=sequence, kind=kind)
        for sequence in sequences_of(experiment, scope)
        if len(experiment.pairs[sequence]) > 1
    ]


def drives_of(experiment, scope, kind):
    """What is drawn, or listed, along each sequence of a scope, of enough pairs."""
    return [
        at(paths.DRIVE, experiment=experiment.name, sequence=sequence, kind=kind)
        for sequence in sequences_of(experiment, scope)
        if "drive" in experiment.figures
        and len(experiment.pairs[sequence]) >= selection.FEWEST_OF_A_DRIVE
    ]


def scenes_of(experiment, scope, kind):
    return [
        at(
            paths.SCENE,
            experiment=experiment.name,
            sequence=sequence,
            reference=reference,
            source=source,
            kind=kind,
        )
        for sequence, pairs in experiment.scenes.items()
        if scope in (experiment.name, f"{experiment.name}/{sequence}")
        for reference, source in pairs
    ]


def rankings_of(experiment, scope):
    """Medians are of pairs; over the perturbations of a grid they would mean little.

    So they would over pairs that are wrong in different ways.
    """
    if experiment.measured or any(len(levels) > 1 for levels in experiment.levels.values()):
        return []
    return [at(paths.OUTLIER_RULES, scope=scope)]


def selected_scopes():
    """Experiment and scope of all that is selected."""
    experiments = [CONFIG.experiments[name] for name in CONFIG.run]
    return [(experiment, scope) for experiment in experiments for scope in scopes(experiment)]


def joined_scopes():
    """Name and scope of the experiments of several estimators that are selected."""
    return [
        (name, scope.replace(first, name, 1))
        for name in CONFIG.joined
        for first in [next(iter(CONFIG.by_estimator[name].values()))]
        for scope in scopes(CONFIG.experiments[first])
    ]


def experiments_of(wildcards):
    """The experiments that one of several estimators, with a wildcard {scope}, is made of."""
    name = wildcards["scope"].split("/")[0]
    return [CONFIG.experiments[part] for part in CONFIG.by_estimator[name].values()]


def tables_of_estimators(table):
    """Input function: a table of each estimator, of an experiment of several or a sequence of it."""

    def of_each(wildcards):
        _, *sequence = wildcards.scope.split("/")
        return [
            at(paths.TABLE, scope="/".join([experiment.name, *sequence]), table=table)
            for experiment in experiments_of(wildcards)
        ]

    return of_each


def tables_of_what_if(wildcards):
    """The shap tables of an experiment, or of a sequence of it, and of what its what_if makes."""
    name = wildcards.scope.split("/")[0]
    parts = (name, *CONFIG.what_if[name].values())
    return [
        at(paths.TABLE, scope=wildcards.scope.replace(name, part, 1), table="shap")
        for part in parts
    ]


def what_if_of(experiment, scope):
    """The table of what an experiment becomes with other options; "" where none are tried."""
    return at(paths.WHAT_IF, scope=scope, kind="csv") if experiment.what_if else ""


def studies_of(wildcards):
    """How the numbers of each estimator of an experiment of several came about."""
    return [study_of({"experiment": found.name}) for found in experiments_of(wildcards)]


def plugins_of_estimators(wildcards):
    """What `digests.plugins` finds all estimators of an experiment of several and its causes by."""
    each = [plugins_of({"experiment": found.name}) for found in experiments_of(wildcards)]
    together = {
        key: sorted({name for names in each for name in names.get(key, ())})
        for key in ("modules", "causes")
    }
    return {"kinds": sorted({names["kind"] for names in each}), **together}


def code_of_estimators(rule):
    """Digest of a rule's script with the causes and the kinds of all of its estimators."""
    script = source(f"workflow/scripts/{rule}.py")
    return lambda wildcards: digests.code_digest(
        script, digests.plugins(plugins_of_estimators(wildcards))
    )


def study_of_estimators(wildcards):
    """What all estimators of an experiment of several have in common, under its name."""
    first, *_ = studies_of(wildcards)
    return {**first, "name": wildcards["scope"].split("/")[0]}


def joined_sections():
    """What the report reads of each selected experiment of several estimators."""
    return [
        {
            "scope": scope,
            "study": study_of_estimators({"scope": scope}),
            "parts": [found.name for found in experiments_of({"scope": scope})],
            "table": at(paths.BY_ESTIMATOR, scope=scope, kind="csv"),
            "figure": at(paths.BY_ESTIMATOR_FIGURE, scope=scope, kind="svg"),
        }
        for _, scope in joined_scopes()
    ]


def sections():
    """What report and comparison read of each selected scope."""
    return [
        {
            "scope": scope,
            "study": study_of({"experiment": experiment.name}),
            "shap": at(paths.TABLE, scope=scope, table="shap"),
            "directions": at(paths.TABLE, scope=scope, table="directions"),
            "uncertainty": at(paths.TABLE, scope=scope, table="uncertainty"),
            "pairs": at(paths.TABLE, scope=scope, table="pairs"),
            "fit": at(paths.TABLE, scope=scope, table="fit"),
            "diagnoses": diagnoses_of(experiment, scope),
            "what_if": what_if_of(experiment, scope),
            "figures": figures_of(experiment, scope, "svg"),
            "rankings": rankings_of(experiment, scope),
        }
        for experiment, scope in selected_scopes()
    ]


def compared_sections():
    """The sections with a sequence that the paper has values of.

    Without those of several estimators, which have a figure of their own.
    """
    apart = {part for name in CONFIG.joined for part in CONFIG.by_estimator[name].values()}
    with open(source("reference/table1.csv"), encoding="utf-8") as table:
        known = {row["sequence"] for row in csv.DictReader(table)}
    return [
        section
        for section in sections()
        if known & set(section["study"]["titles"]) and section["study"]["name"] not in apart
    ]


def files_of(sections, *tables):
    """The tables, rankings and pictures of sections."""
    return [
        path
        for section in sections
        for path in [
            *(section[table] for table in tables),
            *section["rankings"],
            *section["figures"],
        ]
    ]


def titles():
    return {key: sequence.title for key, sequence in CONFIG.data.items()}


def look_at_what_is_there():
    """Put aside what another plan made, and say it; not while another Snakemake is at work."""
    if IS_SO_FAR:
        return
    for line in start.look(PLANS, CONFIG.planned, CONFIG.sequences, IS_RUN):
        logger.info(line)


@cache  # so that its lines are said once
def targets():
    """The files of every selected experiment that has a selected sequence."""
    for line in CONFIG.remarks:
        logger.info(line)
    for name in CONFIG.run:
        if not selected_sequences(CONFIG.experiments[name]):
            known = ", ".join(CONFIG.experiments[name].pairs)
            why = f"none of its sequences ({known}) is selected" if known else "it has no pair"
            logger.info(f"Skipping {name}: {why}.")
    found = files_of(sections(), "uncertainty", "shap", "directions", "pairs", "fit")
    for experiment, scope in selected_scopes():
        found.append(at(paths.TABLE, scope=scope, table="covariances"))
        found += figures_of(experiment, scope, "png") + figures_of(experiment, scope, "txt")
        found += scenes_of(experiment, scope, "html") + drives_of(experiment, scope, "csv")
        if experiment.what_if:
            found += [at(paths.WHAT_IF, scope=scope, kind=kind) for kind in ("csv", "md")]
        if rankings_of(experiment, scope):
            found += [at(paths.MEDIANS, scope=scope, kind=kind) for kind in ("csv", "md", "tex")]
    for _, scope in joined_scopes():
        tables = [at(paths.BY_ESTIMATOR, scope=scope, kind=kind) for kind in ("csv", "md", "tex")]
        kinds = ("png", "svg", "txt")
        found += tables + [at(paths.BY_ESTIMATOR_FIGURE, scope=scope, kind=kind) for kind in kinds]
    if compared_sections():
        found += [at(paths.COMPARISON, kind=k) for k in ("csv", "md", "png", "svg", "txt")]
    if not found:
        raise WorkflowError(
            f"None of the experiments {', '.join(CONFIG.run)} has a pair in the sequences "
            f"{', '.join(CONFIG.sequences)}.\nHint: select others with `run` or `sequences`."
        )
    return [*found, paths.REPORT, paths.SUMMARY, paths.PROVENANCE]
