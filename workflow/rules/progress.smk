"""What a person sees while the workflow runs; see icpshap/jobs/progress.py."""

import signal
import sys

from snakemake.iocontainers import Wildcards

ESTIMATING = ("run_icp", "estimate_covariances", "estimate_both")


def settings_and_runs(wildcards):
    """Settings and runs of a job that estimates poses."""
    wildcards = Wildcards(fromdict=wildcards)
    settings = sum(part.stop - part.start for part in parts_of(wildcards))
    return settings, settings * estimator_of(wildcards).number_of_runs


def planned_settings_and_runs():
    """Settings and runs of all jobs that are about to estimate poses."""
    jobs = [job for job in workflow.dag.needrun_jobs() if job.rule.name in ESTIMATING]
    counts = [settings_and_runs(job.wildcards_dict) for job in jobs]
    return [sum(part) for part in zip(*counts)] or [0, 0]


CTRL_C = parents.CtrlC(progress.STOPPED)
JOB_LINES = progress.Progress(sys.stderr, planned_settings_and_runs, settings_and_runs, ESTIMATING)
if workflow.is_main_process:
    # A workflow that has this as a module speaks for itself.
    if not IS_MODULE:
        signal.signal(signal.SIGINT, CTRL_C)
        shell.prefix(parents.DEAF)
        stopped = lambda: CTRL_C.pressed
        progress.replace_job_lines(logger, JOB_LINES, lambda: workflow.dryrun, stopped)
    parents.be_parent()
    look_at_what_is_there()
else:
    parents.be_nobodys()
