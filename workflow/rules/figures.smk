"""From tables to figures, each with its caption.

Outputs: results/{scope}/figures/{figure}.{png,svg,txt}, where {scope} is an experiment or one
sequence of it, and
results/{experiment}/{sequence}/figures/scene_{reference}-{source}.{png,svg,txt,html}
"""


rule draw_figure:
    """Draw a figure of an experiment, or of one sequence of it."""
    input:
        "results/{scope}/shap.parquet",
    output:
        png=report(
            "results/{scope}/figures/{figure}.png",
            caption="../report/figure.rst",
            category="{scope}",
            subcategory="Figures",
            labels={"figure": "{figure}"},
        ),
        svg="results/{scope}/figures/{figure}.svg",
        caption="results/{scope}/figures/{figure}.txt",
    log:
        "logs/draw_figure/{scope}/{figure}.log",
    benchmark:
        "logs/draw_figure/{scope}/{figure}.tsv"
    wildcard_constraints:
        figure="|".join(name for names in FIGURES.values() for name in names),
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("draw_figure"),
        study=study_of,
    script:
        "../scripts/draw_figure.py"


rule draw_scene:
    """Draw the scans and the poses of a pair: a picture and an interactive page."""
    input:
        reference="resources/{sequence}/scan_{reference}.parquet",
        source="resources/{sequence}/scan_{source}.parquet",
        poses="resources/{sequence}/poses.parquet",
        overlap="resources/{sequence}/overlap/{reference}-{source}.parquet",
        pairs="results/{experiment}/{sequence}/pairs.parquet",
        runs=runs_of_scene,
    output:
        png=report(
            "results/{experiment}/{sequence}/figures/scene_{reference}-{source}.png",
            caption="../report/figure.rst",
            category="{experiment}",
            subcategory="Scans and poses",
            labels={"sequence": "{sequence}", "pair": "{reference}-{source}"},
        ),
        svg="results/{experiment}/{sequence}/figures/scene_{reference}-{source}.svg",
        caption="results/{experiment}/{sequence}/figures/scene_{reference}-{source}.txt",
        page=report(
            "results/{experiment}/{sequence}/figures/scene_{reference}-{source}.html",
            caption="../report/figure.rst",
            category="{experiment}",
            subcategory="Scans and poses",
            labels={"sequence": "{sequence}", "pair": "{reference}-{source}, interactive"},
        ),
    log:
        "logs/draw_scene/{experiment}/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/draw_scene/{experiment}/{sequence}/{reference}-{source}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=code_digest("draw_scene"),
        perturbation=perturbation_of_scene,
        seed=SETTINGS.seed,
        study=study_of,
    script:
        "../scripts/draw_scene.py"
