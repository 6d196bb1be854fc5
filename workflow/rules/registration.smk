"""From scans to pose samples and covariances.

Data and checks go first (priority), so that what can be known to be wrong is said before any ICP.

Outputs: results/{experiment}/{sequence}/{pairs,overlaps,fit_numbers}/{batch}.parquet, and, as the
experiment's estimator returns samples, covariances or both,
results/{experiment}/{sequence}/runs/{job}.parquet and
results/{experiment}/{sequence}/estimates/{job}.parquet
"""


rule check_pairs:
    """Describe pairs, and stop before any is registered that cannot be perturbed as asked."""
    input:
        scans=of_old(paths.PAIRS, plan_of_checks, scans_for(pairs_of_batch)),
        poses=of_old(paths.PAIRS, plan_of_checks, poses_of),
    output:
        pairs=paths.PAIRS,
        overlaps=paths.OVERLAPS,
        fit_numbers=paths.FIT_NUMBERS,
    log:
        "logs/check_pairs/{experiment}/{sequence}/{batch}.log",
    benchmark:
        "logs/check_pairs/{experiment}/{sequence}/{batch}.tsv"
    wildcard_constraints:
        experiment=before_many("check_pairs"),
    priority: 10
    threads: 1
    resources:
        mem_mb=memory_of_scans(400, 400),
        runtime=time_of_scans(pairs_of_batch, time_limits.OF_CHECK),
    params:
        plan=plan_of_checks,
        stop_at_red=CONFIG.stop_at_red,
    script:
        "../scripts/check_pairs.py"


rule run_icp:
    """Run ICP for the settings of a job: a share of a pair, or several pairs of a sequence."""
    input:
        scans=of_old(estimates_template, plan_of_job, scans_for(pairs_of_job)),
        poses=of_old(estimates_template, plan_of_job, poses_of),
        overlaps=of_old(estimates_template, plan_of_job, checks_for(paths.OVERLAPS, pairs_of_job)),
        pairs=of_old(estimates_template, plan_of_job, checks_for(paths.PAIRS, pairs_of_job)),
        instances=of_old(estimates_template, plan_of_job, instances_of),
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
        runtime=time_of_registrations,
    params:
        plan=plan_of_job,
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
