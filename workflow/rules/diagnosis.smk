"""What is wrong with the pairs of a sequence, before anything is perturbed.

Outputs: results/{experiment}/{sequence}/diagnosis/{batch}.parquet, of experiments that explain what
is diagnosed results/{experiment}/{sequence}/instances/{batch}.parquet, of all pairs together
results/{experiment}/{sequence}/{diagnosis,instances}.parquet, and
results/{experiment}/{sequence}/figures/diagnosis.{png,svg,txt}
"""

DIAGNOSED = at(paths.OF_BATCH, table="diagnosis")
FOUND_INSTANCES = at(paths.OF_BATCH, table="instances")


rule diagnose_pairs:
    """Say which cause stands out in each of some pairs of a sequence, beside those around it."""
    input:
        scans=of_old(DIAGNOSED, plan_of_diagnosis, scans_for(pairs_beside)),
        poses=of_old(DIAGNOSED, plan_of_diagnosis, poses_of),
        overlaps=of_old(DIAGNOSED, plan_of_diagnosis, checks_for(paths.OVERLAPS, pairs_beside)),
    output:
        DIAGNOSED,
    log:
        "logs/diagnose_pairs/{experiment}/{sequence}/{batch}.log",
    benchmark:
        "logs/diagnose_pairs/{experiment}/{sequence}/{batch}.tsv"
    wildcard_constraints:
        experiment=before_many("diagnose_pairs"),
    threads: 1
    resources:
        mem_mb=memory_of_scans(500, 900),
        runtime=time_of_diagnosis,
    params:
        plan=plan_of_diagnosis,
    script:
        "../scripts/diagnose_pairs.py"


rule find_instances:
    """Say what is played of some pairs: the levels that were diagnosed, and on which pair."""
    input:
        diagnosis=DIAGNOSED,
        scans=of_old(FOUND_INSTANCES, plan_of_instances, scans_for(pairs_beside)),
        poses=of_old(FOUND_INSTANCES, plan_of_instances, poses_of),
        overlaps=of_old(
            FOUND_INSTANCES, plan_of_instances, checks_for(paths.OVERLAPS, pairs_beside)
        ),
    output:
        FOUND_INSTANCES,
    log:
        "logs/find_instances/{experiment}/{sequence}/{batch}.log",
    benchmark:
        "logs/find_instances/{experiment}/{sequence}/{batch}.tsv"
    wildcard_constraints:
        experiment=before_many("find_instances"),
    priority: 10
    threads: 1
    resources:
        mem_mb=memory_of_scans(300, 250),
        runtime=time_of_scans(pairs_beside, time_limits.OF_INSTANCE),
    params:
        plan=plan_of_instances,
    script:
        "../scripts/find_instances.py"


rule join_pairs:
    """Put what jobs found of some pairs of a sequence each into the table of all of its pairs."""
    input:
        files_of_batches,
    output:
        paths.OF_SEQUENCE,
    log:
        "logs/join_pairs/{experiment}/{sequence}/{table}.log",
    benchmark:
        "logs/join_pairs/{experiment}/{sequence}/{table}.tsv"
    wildcard_constraints:
        table="diagnosis|instances",
    priority: 10
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        plan=plan_of_joined_pairs,
        batches=digests_of_batches,
    script:
        "../scripts/join_pairs.py"


rule draw_diagnosis:
    """Draw which causes stand out in which pairs of a sequence."""
    input:
        paths.DIAGNOSIS,
    output:
        png=report(
            at(paths.DIAGNOSIS_FIGURE, kind="png"),
            caption="../report/figure.rst",
            category="{experiment}",
            subcategory="Figures",
            labels={"sequence": "{sequence}", "figure": "diagnosis"},
        ),
        svg=at(paths.DIAGNOSIS_FIGURE, kind="svg"),
        caption=at(paths.DIAGNOSIS_FIGURE, kind="txt"),
    log:
        "logs/draw_diagnosis/{experiment}/{sequence}.log",
    benchmark:
        "logs/draw_diagnosis/{experiment}/{sequence}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code("draw_diagnosis"),
        titles=lambda wildcards: {wildcards.sequence: sequence_of(wildcards).title},
    script:
        "../scripts/draw_diagnosis.py"
