"""What is wrong with the pairs of a sequence, before anything is perturbed.

Outputs: results/{experiment}/{sequence}/diagnosis.parquet, of experiments that explain what is
diagnosed results/{experiment}/{sequence}/instances.parquet,
results/{experiment}/{sequence}/figures/diagnosis.{png,svg,txt}
"""


rule diagnose_sequence:
    """Say which cause stands out in each pair of a sequence, beside the other pairs."""
    input:
        scans=of_old(paths.DIAGNOSIS, plan_of_diagnosis, scans_for(pairs_of)),
        poses=of_old(paths.DIAGNOSIS, plan_of_diagnosis, poses_of),
        overlaps=of_old(paths.DIAGNOSIS, plan_of_diagnosis, checks_for(paths.OVERLAPS, pairs_of)),
    output:
        paths.DIAGNOSIS,
    log:
        "logs/diagnose_sequence/{experiment}/{sequence}.log",
    benchmark:
        "logs/diagnose_sequence/{experiment}/{sequence}.tsv"
    wildcard_constraints:
        experiment=before_many("diagnose_sequence"),
    threads: 1
    resources:
        mem_mb=memory_of_scans(500, 900),
        runtime=time_of_diagnosis,
    params:
        plan=plan_of_diagnosis,
    script:
        "../scripts/diagnose_sequence.py"


rule find_instances:
    """Say what is played of each pair: the levels that were diagnosed, and on which pair."""
    input:
        diagnosis=paths.DIAGNOSIS,
        scans=of_old(paths.INSTANCES, plan_of_instances, scans_for(pairs_of)),
        poses=of_old(paths.INSTANCES, plan_of_instances, poses_of),
        overlaps=of_old(paths.INSTANCES, plan_of_instances, checks_for(paths.OVERLAPS, pairs_of)),
    output:
        paths.INSTANCES,
    log:
        "logs/find_instances/{experiment}/{sequence}.log",
    benchmark:
        "logs/find_instances/{experiment}/{sequence}.tsv"
    priority: 10
    threads: 1
    resources:
        mem_mb=memory_of_scans(300, 250),
        runtime=time_of_scans(pairs_of, time_limits.OF_INSTANCE),
    params:
        plan=plan_of_instances,
    script:
        "../scripts/find_instances.py"


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
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code("draw_diagnosis"),
        titles=lambda wildcards: {wildcards.sequence: sequence_of(wildcards).title},
    script:
        "../scripts/draw_diagnosis.py"
