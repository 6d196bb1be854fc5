"""From scans to ICP runs.

Data and checks go first (priority), so that what can be known to be wrong is said before any ICP.

Outputs: results/{experiment}/{sequence}/pairs/{reference}-{source}.parquet,
results/{experiment}/{sequence}/runs/{reference}-{source}/{chunk}.parquet
"""


rule check_pair:
    """Describe a pair, and stop before it is registered if it cannot be perturbed as asked."""
    input:
        reference="resources/{sequence}/scan_{reference}.parquet",
        source="resources/{sequence}/scan_{source}.parquet",
        poses="resources/{sequence}/poses.parquet",
        overlap="resources/{sequence}/overlap/{reference}-{source}.parquet",
    output:
        "results/{experiment}/{sequence}/pairs/{reference}-{source}.parquet",
    log:
        "logs/check_pair/{experiment}/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/check_pair/{experiment}/{sequence}/{reference}-{source}.tsv"
    priority: 10
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("check_pair"),
        largest_reduction=lambda wildcards: max(experiment_of(wildcards).levels["partial_overlap"]),
        minimum_overlap=SETTINGS.perturbation.minimum_overlap,
        minimum_range=lambda wildcards: estimator_of(wildcards).minimum_range,
    script:
        "../scripts/check_pair.py"


rule run_icp:
    """Run ICP for a share of the settings of a pair."""
    input:
        reference="resources/{sequence}/scan_{reference}.parquet",
        source="resources/{sequence}/scan_{source}.parquet",
        poses="resources/{sequence}/poses.parquet",
        overlap="resources/{sequence}/overlap/{reference}-{source}.parquet",
        pair="results/{experiment}/{sequence}/pairs/{reference}-{source}.parquet",
    output:
        "results/{experiment}/{sequence}/runs/{reference}-{source}/{chunk}.parquet",
    log:
        "logs/run_icp/{experiment}/{sequence}/{reference}-{source}/{chunk}.log",
    benchmark:
        "logs/run_icp/{experiment}/{sequence}/{reference}-{source}/{chunk}.tsv"
    threads: 1
    resources:
        mem_mb=1500,
    params:
        code=code_digest("run_icp"),
        seed=SETTINGS.seed,
        perturbation=asdict(SETTINGS.perturbation),
        registration=lambda wildcards: asdict(estimator_of(wildcards).registration),
        settings=lambda wildcards: [
            asdict(setting) for setting in jobs_of(wildcards)[int(wildcards.chunk)]
        ],
    script:
        "../scripts/run_icp.py"
