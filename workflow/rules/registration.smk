"""From scans to pose samples and covariances.

Data and checks go first (priority), so that what can be known to be wrong is said before any ICP.

Outputs: results/{experiment}/{sequence}/pairs/{reference}-{source}.parquet,
results/{experiment}/{sequence}/fit_numbers.parquet, and, as the experiment's
estimator returns samples, covariances or both, results/{experiment}/{sequence}/runs/{job}.parquet
and results/{experiment}/{sequence}/estimates/{job}.parquet
"""


rule check_pair:
    """Describe a pair, and stop before it is registered if it cannot be perturbed as asked."""
    input:
        reference=scan_of_pair("reference"),
        source=scan_of_pair("source"),
        poses=poses_for(paths.PAIR, plan_of_pair),
        overlap=paths.OVERLAP,
        # Demanded or not, it decides no number of the pair.
        fit=paths.FIT_NUMBERS if CONFIG.stop_at_red else [],
    output:
        paths.PAIR,
    log:
        "logs/check_pair/{experiment}/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/check_pair/{experiment}/{sequence}/{reference}-{source}.tsv"
    priority: 10
    threads: 1
    resources:
        mem_mb=memory_of_scans(300, 250),
    params:
        plan=plan_of_pair,
    script:
        "../scripts/check_pair.py"


rule measure_fit:
    """Measure how the settings of an experiment fit the scans of a sequence."""
    input:
        scans=scan_files_of_pairs,
        poses=poses_for(paths.FIT_NUMBERS, plan_of_fit),
        overlaps=overlaps_of_pairs,
    output:
        paths.FIT_NUMBERS,
    log:
        "logs/measure_fit/{experiment}/{sequence}.log",
    benchmark:
        "logs/measure_fit/{experiment}/{sequence}.tsv"
    priority: 15
    threads: 1
    resources:
        mem_mb=memory_of_scans(300, 400),
    params:
        plan=plan_of_fit,
        scans=scans_of_pairs,
    script:
        "../scripts/measure_fit.py"


rule run_icp:
    """Run ICP for the settings of a job: a share of a pair, or several pairs of a sequence."""
    input:
        scans=scans_of_job,
        poses=poses_of_job,
        overlaps=overlaps_of_job,
        pairs=checks_of_job,
        instances=instances_of_job,
        training=descriptors_of_job,
    output:
        runs=paths.RUNS,
    log:
        "logs/run_icp/{experiment}/{sequence}/{job}.log",
    benchmark:
        "logs/run_icp/{experiment}/{sequence}/{job}.tsv"
    wildcard_constraints:
        experiment=experiments_that_return(samples=True, covariances=False),
    threads: 1
    resources:
        mem_mb=memory_of_scans(1050, 450),
    params:
        plan=plan_of_job,
        scans=scans_of,
        overlaps=pairs_read,
    script:
        "../scripts/run_icp.py"


use rule run_icp as estimate_covariances with:
    output:
        estimates=paths.ESTIMATES,
    log:
        "logs/estimate_covariances/{experiment}/{sequence}/{job}.log",
    benchmark:
        "logs/estimate_covariances/{experiment}/{sequence}/{job}.tsv"
    wildcard_constraints:
        experiment=experiments_that_return(samples=False, covariances=True),


use rule run_icp as estimate_both with:
    output:
        runs=paths.RUNS,
        estimates=paths.ESTIMATES,
    log:
        "logs/estimate_both/{experiment}/{sequence}/{job}.log",
    benchmark:
        "logs/estimate_both/{experiment}/{sequence}/{job}.tsv"
    wildcard_constraints:
        experiment=experiments_that_return(samples=True, covariances=True),
