"""From pose samples to what another estimator learns from.

Outputs: results/{experiment}/{sequence}/descriptors.parquet, for experiments that an estimator names
in `training`
"""


rule train_estimator:
    """Descriptors of a sequence's perturbed pairs, and the covariances of their runs."""
    input:
        scans=scans_for(pairs_of),
        poses=paths.POSES,
        overlaps=checks_for(paths.OVERLAPS, pairs_of),
        pairs=checks_for(paths.PAIRS, pairs_of),
        runs=runs_of_sequence,
        estimates=estimates_of_sequence,
    output:
        paths.DESCRIPTORS,
    log:
        "logs/train_estimator/{experiment}/{sequence}.log",
    benchmark:
        "logs/train_estimator/{experiment}/{sequence}.tsv"
    threads: 1
    resources:
        mem_mb=memory_of_scans(2000, 450),
        runtime=time_of_training,
    params:
        plan=lambda wildcards: PLANS.descriptors(wildcards.experiment, wildcards.sequence),
        jobs=lambda wildcards: PLANS.job_digests(wildcards.experiment, wildcards.sequence),
    script:
        "../scripts/train_estimator.py"
