"""What a person sees while the workflow runs; see icpshap/progress.py."""

import sys
from types import SimpleNamespace

from icpshap.jobs import progress


def settings_and_runs(wildcards):
    """ICP settings and runs of a run_icp job."""
    wildcards = SimpleNamespace(**wildcards)
    settings = len(jobs_of(wildcards)[int(wildcards.chunk)])
    return settings, settings * estimator_of(wildcards).runs


def planned_settings_and_runs():
    """ICP settings and runs of all run_icp jobs that are about to run."""
    jobs = [job for job in workflow.dag.needrun_jobs() if job.rule.name == "run_icp"]
    counts = [settings_and_runs(job.wildcards_dict) for job in jobs]
    return [sum(part) for part in zip(*counts)] or [0, 0]


JOB_LINES = progress.Progress(sys.stderr, planned_settings_and_runs, settings_and_runs)
if workflow.is_main_process:
    progress.replace_job_lines(logger, JOB_LINES, lambda: workflow.dryrun)
