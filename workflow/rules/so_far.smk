"""What is there while the workflow runs: a report of the pairs that are finished.

It is of no use to the workflow itself, which makes its report at the end.

Outputs: results/so_far/report.html, and below results/so_far/{experiment}/{sequence} the tables and
figures that it is made of
"""

from icpshap.jobs.finished import finished

if workflow.is_main_process and IS_SO_FAR and "--nolock" not in sys.argv:
    raise WorkflowError(
        "so_far: expected --nolock too: at its end Snakemake would take away the lock of the run "
        "that is at work.\nHint: snakemake so_far --nolock -j1 --configfile ..., the target first."
    )


rule so_far:
    """Report on the pairs that are finished, while another Snakemake makes the others."""

    # Without input, so that nothing is made for it.
    output:
        directory(paths.SO_FAR),
    log:
        "logs/so_far/so_far.log",
    localrule: True
    threads: 1
    resources:
        mem_mb=2000,
    params:
        code=code("so_far"),
        found=lambda wildcards: [
            finished(PLANS, experiment.name, sequence)
            for experiment in map(CONFIG.experiments.get, CONFIG.run)
            for sequence in selected_sequences(experiment)
        ],
        studies=lambda wildcards: {name: study_of({"experiment": name}) for name in CONFIG.run},
        figures=lambda wildcards: {
            name: figure_names(CONFIG.experiments[name]) for name in CONFIG.run
        },
        config=WHOLE_CONFIG,
        root=ROOT,
        logs=paths.LOGS,
        sequences={key: CONFIG.data[key].kind for key in CONFIG.sequences},
    script:
        "../scripts/so_far.py"
