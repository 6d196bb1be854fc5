"""From pose samples to what another estimator learns from.

Outputs: results/{experiment}/{sequence}/descriptors.parquet, for experiments that an estimator names
in `training`
"""


rule train_estimator:
    """Descriptors of a sequence's perturbed pairs, and the covariances of their runs."""
    input:
        scans=scan_files_of_pairs,
        poses=paths.POSES,
        overlaps=overlaps_of_pairs,
        pairs=checks_of_pairs,
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
    params:
        plan=lambda wildcards: PLANS.descriptors(wildcards.experiment, wildcards.sequence),
        jobs=lambda wildcards: PLANS.job_digests(wildcards.experiment, wildcards.sequence),
        scans=scans_of_pairs,
    script:
        "../scripts/train_estimator.py"
