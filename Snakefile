"""Why is this registration uncertain? The experiment of the paper, from scans to explanations.

snakemake -j2                                       the whole experiment on the real data
snakemake -j2 --configfile config/demo.yaml         both experiments on simulated scans, offline
snakemake -j2 --config 'sequences=[stairs]'         one sequence
"""

from snakemake.utils import min_version

min_version("9.0")


configfile: str(workflow.current_basedir.join("config.yaml").get_path_or_uri(secret_free=True))


include: "workflow/rules/common.smk"
include: "workflow/rules/data.smk"
include: "workflow/rules/diagnosis.smk"
include: "workflow/rules/registration.smk"
include: "workflow/rules/training.smk"
include: "workflow/rules/explanation.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/report.smk"
include: "workflow/rules/progress.smk"


localrules:
    all,
    checksums,
    compare_with_paper,
    draw_diagnosis,
    draw_figure,
    draw_scene,
    join_estimators,
    join_sequences,
    join_what_if,
    median_table,
    provenance,
    read_poses,
    register_poses,
    report,
    simulate_poses,


rule all:
    """Everything that the selected experiments make of the selected sequences."""
    default_target: True
    input:
        targets(),
        paths.CHECKSUMS,


onstart:
    CTRL_C.has_jobs = True
    if any(CONFIG.data[key].kind == "archive" for key in CONFIG.sequences):
        logger.info(citation.NOTICE)


onsuccess:
    # Written by this run, that is, not by an earlier one with another selection.
    if os.path.exists(paths.SUMMARY) and os.path.getmtime(paths.SUMMARY) > STARTED:
        with open(paths.SUMMARY, encoding="utf-8") as summary:
            print(summary.read())


onerror:
    if CTRL_C.pressed:
        logger.error(progress.STOPPED)
    elif JOB_LINES.failed:
        logger.error(progress.failure(JOB_LINES.failed))
