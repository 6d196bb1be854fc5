"""From tables to figures, each with its caption.

Outputs: results/{scope}/figures/{figure}.{png,svg,txt}, where {scope} is an experiment or one
sequence of it, and
results/{experiment}/{sequence}/figures/drive.{png,svg,txt,csv},
results/{experiment}/{sequence}/figures/scene_{reference}-{source}.{png,svg,txt,html}
"""


rule draw_figure:
    """Draw a figure of an experiment, or of one sequence of it."""
    input:
        shap=at(paths.TABLE, table="shap"),
        directions=at(paths.TABLE, table="directions"),
    output:
        png=report(
            at(paths.FIGURE, kind="png"),
            caption="../report/figure.rst",
            category="{scope}",
            subcategory="Figures",
            labels={"figure": "{figure}"},
        ),
        svg=at(paths.FIGURE, kind="svg"),
        caption=at(paths.FIGURE, kind="txt"),
    log:
        "logs/draw_figure/{scope}/{figure}.log",
    benchmark:
        "logs/draw_figure/{scope}/{figure}.tsv"
    wildcard_constraints:
        figure="|".join(
            sorted({name for found in CONFIG.experiments.values() for name in figure_names(found)})
        )
        or "(?!)",
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_of_experiment("draw_figure"),
        plugins=plugins_of,
        study=study_of,
    script:
        "../scripts/draw_figure.py"


rule draw_drive:
    """Draw the numbers of a sequence along it, and list the pairs that are most in doubt."""
    input:
        shap=at(paths.OF_SEQUENCE, table="shap"),
    output:
        png=report(
            at(paths.DRIVE, kind="png"),
            caption="../report/figure.rst",
            category="{experiment}",
            subcategory="Figures",
            labels={"sequence": "{sequence}", "figure": "drive"},
        ),
        svg=at(paths.DRIVE, kind="svg"),
        caption=at(paths.DRIVE, kind="txt"),
        csv=at(paths.DRIVE, kind="csv"),
    log:
        "logs/draw_drive/{experiment}/{sequence}.log",
    benchmark:
        "logs/draw_drive/{experiment}/{sequence}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_of_experiment("draw_drive"),
        plugins=plugins_of,
        study=study_of,
    script:
        "../scripts/draw_drive.py"


rule draw_scene:
    """Draw the scans and the poses of a pair: a picture and an interactive page."""
    input:
        scans=scans_for(pair_of_scene),
        poses=paths.POSES,
        overlaps=checks_for(paths.OVERLAPS, pair_of_scene),
        pairs=at(paths.OF_SEQUENCE, table="pairs"),
        runs=runs_of_scene,
    output:
        png=report(
            at(paths.SCENE, kind="png"),
            caption="../report/figure.rst",
            category="{experiment}",
            subcategory="Scans and poses",
            labels={"sequence": "{sequence}", "pair": "{reference}-{source}"},
        ),
        svg=at(paths.SCENE, kind="svg"),
        caption=at(paths.SCENE, kind="txt"),
        page=report(
            at(paths.SCENE, kind="html"),
            caption="../report/figure.rst",
            category="{experiment}",
            subcategory="Scans and poses",
            labels={"sequence": "{sequence}", "pair": "{reference}-{source}, interactive"},
        ),
    log:
        "logs/draw_scene/{experiment}/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/draw_scene/{experiment}/{sequence}/{reference}-{source}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=memory_of_scans(500, 250),
    params:
        code=code_of_experiment("draw_scene"),
        plugins=plugins_of,
        instance=perturbation_of_scene,
        estimator=lambda wildcards: estimator_of(wildcards).decides(),
        perturbation=asdict(CONFIG.perturbation),
        method=method_of,
        seed=CONFIG.seed,
        study=study_of,
    script:
        "../scripts/draw_scene.py"
