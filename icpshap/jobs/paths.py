"""Where the workflow's files lie: every path stands here, once.

`{scope}` is an experiment, or one sequence of it: `{experiment}/{sequence}`.
"""

ARCHIVE_CACHE = "resources/{sequence}/archive"
SCANS = "resources/{sequence}/scans/{batch}.parquet"
POSES = "resources/{sequence}/poses.parquet"
REGISTRATIONS = "resources/{sequence}/registered/{batch}.parquet"

PAIRS = "results/{experiment}/{sequence}/pairs/{batch}.parquet"
OVERLAPS = "results/{experiment}/{sequence}/overlaps/{batch}.parquet"
FIT_NUMBERS = "results/{experiment}/{sequence}/fit_numbers/{batch}.parquet"
OF_BATCH = "results/{experiment}/{sequence}/{table}/{batch}.parquet"
"""What a job found of some pairs, `diagnosis` or `instances`, before it is in the table of all."""

DIAGNOSIS = "results/{experiment}/{sequence}/diagnosis.parquet"
DIAGNOSIS_FIGURE = "results/{experiment}/{sequence}/figures/diagnosis.{kind}"
INSTANCES = "results/{experiment}/{sequence}/instances.parquet"
RUNS = "results/{experiment}/{sequence}/runs/{job}.parquet"
ESTIMATES = "results/{experiment}/{sequence}/estimates/{job}.parquet"
OF_SEQUENCE = "results/{experiment}/{sequence}/{table}.parquet"
DESCRIPTORS = "results/{experiment}/{sequence}/descriptors.parquet"
OF_EXPERIMENT = "results/{experiment}/{table}.parquet"
TABLE = "results/{scope}/{table}.parquet"
"""Tables of an explanation, in the folder of a sequence and joined in that of the experiment."""

FIGURE = "results/{scope}/figures/{figure}.{kind}"
SCENE = "results/{experiment}/{sequence}/figures/scene_{reference}-{source}.{kind}"
DRIVE = "results/{experiment}/{sequence}/figures/drive.{kind}"
MEDIANS = "results/{scope}/tables/median_shap.{kind}"
OUTLIER_RULES = "results/{scope}/tables/outlier_rules.csv"
BY_ESTIMATOR = "results/{scope}/tables/by_estimator.{kind}"
BY_ESTIMATOR_FIGURE = "results/{scope}/figures/by_estimator.{kind}"
WHAT_IF = "results/{scope}/tables/what_if.{kind}"
COMPARISON = "results/comparison/paper.{kind}"

REPORT = "results/report.html"
SUMMARY = "results/summary.txt"
PROVENANCE = "results/provenance.yaml"
CHECKSUMS = "results/checksums.sha256"

SO_FAR = "results/so_far"

LOGS = "logs"


def at(template: str, **values: object) -> str:
    """A template with some of its wildcards filled in; the others stay.

    >>> at("results/{experiment}/{sequence}", experiment="a")
    'results/a/{sequence}'
    """
    for name, value in values.items():
        template = template.replace(f"{{{name}}}", str(value))
    return template
