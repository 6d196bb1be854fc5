"""What a run has finished so far, by the files of its jobs: read where the workflow is planned."""

from typing import Any

from icpshap.jobs import paths
from icpshap.jobs.paths import at
from icpshap.jobs.plans import Plans, digest, is_settled


def finished(planner: Plans, experiment: str, sequence: str) -> dict[str, Any]:
    """What is finished of a sequence: files of jobs and digests of their plans, and pairs.

    A mapping that JSON can hold. planner: a plans.Plans. A file counts if it was made by its plan,
    a pair if all of its jobs' files do.
    """
    names = {"experiment": experiment, "sequence": sequence}
    known = planner.config.experiments[experiment]
    returns = planner.estimator(experiment).returned
    estimated = {"runs": paths.RUNS} if returns.samples else {}
    estimated |= {"estimates": paths.ESTIMATES} if returns.covariances else {}
    jobs = planner.jobs(experiment, sequence)
    plans = [planner.job(experiment, sequence, job) for job in range(len(jobs))]
    done = _settled(estimated.values(), plans, names, "job")
    batches = planner.batches(experiment, sequence)
    checks = [planner.checks(experiment, sequence, batch) for batch in range(len(batches))]
    checked = {"pairs": paths.PAIRS, "fit": paths.FIT_NUMBERS}
    sound = _settled(checked.values(), checks, names, "batch")
    missing = {part.pair for job in set(range(len(jobs))) - set(done) for part in jobs[job]}
    ready = {pair for batch in sound for pair in batches[batch]} - missing
    return {
        **names,
        "pairs": sorted(list(pair) for pair in ready),
        "of": len(known.pairs[sequence]),
        "files": {
            "runs": [],
            "estimates": [],
            "instances": [at(paths.INSTANCES, **names)] if known.measured else [],
            "diagnosis": [at(paths.DIAGNOSIS, **names)] if known.measured else [],
            **{of: [at(file, **names, job=job) for job in done] for of, file in estimated.items()},
            **{of: [at(file, **names, batch=k) for k in sound] for of, file in checked.items()},
        },
        "jobs": [digest(plans[job]) for job in done],
        "checks": [digest(checks[batch]) for batch in sound],
        "planned": planner.explanation(experiment, sequence),
        "figures": list(known.figures),
    }


def _settled(files, plans, names, number):
    """Of files of some templates, numbered, those numbers of which all were made by their plan."""
    return [
        k
        for k, plan in enumerate(plans)
        if all(is_settled(at(file, **names, **{number: k}), plan) for file in files)
    ]
