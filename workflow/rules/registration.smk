"""From scans to ICP runs.

Outputs: results/{experiment}/{sequence}/pairs.parquet,
results/{experiment}/{sequence}/runs/{reference}-{source}/{chunk}.parquet
"""


rule check_pairs:
    """List the pairs of a sequence, and stop before any registration if one cannot be perturbed."""
    input:
        poses="resources/{sequence}/poses.parquet",
        scans=scans_of_pairs,
        overlaps=overlaps_of_pairs,
    output:
        "results/{experiment}/{sequence}/pairs.parquet",
    log:
        "logs/check_pairs/{experiment}/{sequence}.log",
    benchmark:
        "logs/check_pairs/{experiment}/{sequence}.tsv"
    priority: 5
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=code_digest("check_pairs"),
        pairs=pairs_of,
        minimum_overlap=SETTINGS.perturbation.minimum_overlap,
        minimum_range=lambda wildcards: estimator_of(wildcards).minimum_range,
        largest_reduction=lambda wildcards: max(experiment_of(wildcards).levels["partial_overlap"]),
    script:
        "../scripts/check_pairs.py"


rule run_icp:
    """Run ICP for a share of the settings of a pair."""
    input:
        reference="resources/{sequence}/scan_{reference}.parquet",
        source="resources/{sequence}/scan_{source}.parquet",
        poses="resources/{sequence}/poses.parquet",
        overlap="resources/{sequence}/overlap/{reference}-{source}.parquet",
        # Only to come after the check: a further pair in the list changes nothing here.
        pairs=ancient("results/{experiment}/{sequence}/pairs.parquet"),
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
