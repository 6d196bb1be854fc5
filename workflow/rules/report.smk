"""Tables for people, the comparison with the paper, and the report.

Outputs: results/{scope}/tables/median_shap.{csv,md,tex}, results/{scope}/tables/outlier_rules.csv,
results/{scope}/tables/by_estimator.{csv,md,tex}, results/{scope}/figures/by_estimator.{png,svg,txt},
results/{scope}/tables/what_if.{csv,md},
where {scope} is an experiment or one sequence of it; and, for all that was selected,
results/comparison/paper.{csv,md,png,svg}, results/provenance.yaml, results/{report.html,summary.txt},
results/checksums.sha256
"""


report: "../report/workflow.rst"


rule median_table:
    """Rank the uncertainty sources of each sequence, beside the paper's Table 1."""
    input:
        shap=at(paths.TABLE, table="shap"),
        resampled=at(paths.TABLE, table="resampled"),
        paper=source("reference/table1.csv"),
    output:
        md=report(
            at(paths.MEDIANS, kind="md"),
            caption="../report/median_table.rst",
            category="{scope}",
            subcategory="Tables",
            labels={"table": "median Shapley values"},
        ),
        csv=at(paths.MEDIANS, kind="csv"),
        tex=at(paths.MEDIANS, kind="tex"),
        rules=paths.OUTLIER_RULES,
    log:
        "logs/median_table/{scope}.log",
    benchmark:
        "logs/median_table/{scope}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=code_of_experiment("median_table"),
        plugins=plugins_of,
        study=study_of,
        seed=CONFIG.seed,
    script:
        "../scripts/median_table.py"


rule join_estimators:
    """Set the estimators of an experiment of several side by side."""
    input:
        shap=tables_of_estimators("shap"),
        uncertainty=tables_of_estimators("uncertainty"),
    output:
        png=report(
            at(paths.BY_ESTIMATOR_FIGURE, kind="png"),
            caption="../report/figure.rst",
            category="{scope}",
            subcategory="Figures",
            labels={"figure": "by estimator"},
        ),
        svg=at(paths.BY_ESTIMATOR_FIGURE, kind="svg"),
        caption=at(paths.BY_ESTIMATOR_FIGURE, kind="txt"),
        csv=at(paths.BY_ESTIMATOR, kind="csv"),
        md=at(paths.BY_ESTIMATOR, kind="md"),
        tex=at(paths.BY_ESTIMATOR, kind="tex"),
    log:
        "logs/join_estimators/{scope}.log",
    benchmark:
        "logs/join_estimators/{scope}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_of_estimators("join_estimators"),
        plugins=plugins_of_estimators,
        studies=studies_of,
        study=study_of_estimators,
    script:
        "../scripts/join_estimators.py"


rule join_what_if:
    """Set the explained instance beside what it becomes with other options."""
    input:
        shap=tables_of_what_if,
        pairs=at(paths.TABLE, table="pairs"),
    output:
        csv=at(paths.WHAT_IF, kind="csv"),
        md=at(paths.WHAT_IF, kind="md"),
    log:
        "logs/join_what_if/{scope}.log",
    benchmark:
        "logs/join_what_if/{scope}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_of_experiment("join_what_if"),
        plugins=plugins_of,
        study=study_of,
        changes=lambda wildcards: experiment_of(wildcards).what_if,
    script:
        "../scripts/join_what_if.py"


rule compare_with_paper:
    """Set the results of every estimator that was run against the paper's."""
    input:
        sections=files_of(compared_sections(), "shap"),
        figures=source("reference/figures.csv"),
    output:
        png=report(
            at(paths.COMPARISON, kind="png"),
            caption="../report/figure.rst",
            category="Against the paper",
            labels={"figure": "ours against the paper"},
        ),
        svg=at(paths.COMPARISON, kind="svg"),
        caption=at(paths.COMPARISON, kind="txt"),
        csv=at(paths.COMPARISON, kind="csv"),
        md=at(paths.COMPARISON, kind="md"),
    log:
        "logs/compare_with_paper/paper.log",
    benchmark:
        "logs/compare_with_paper/paper.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code("compare_with_paper"),
        sections=compared_sections(),
        titles=titles(),
    script:
        "../scripts/compare_with_paper.py"


rule provenance:
    """Write down what the selected experiments were made with."""
    input:
        files_of(sections(), "uncertainty", "shap", "directions", "pairs"),
    output:
        paths.PROVENANCE,
    log:
        "logs/provenance/provenance.log",
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code("provenance"),
        config=WHOLE_CONFIG,
        commit=commit(ROOT),
        root=ROOT,
        logs=paths.LOGS,
        sequences={key: CONFIG.data[key].kind for key in CONFIG.sequences},
    script:
        "../scripts/provenance.py"


rule report:
    """Make the report of the selected experiments, and the few lines that end a run."""
    input:
        files_of(sections(), "shap", "directions", "uncertainty", "pairs", "fit"),
        # Both or none: where no selected sequence is of the paper, there is nothing to compare.
        compared=[at(paths.COMPARISON, kind=kind) for kind in ("csv", "svg") if compared_sections()],
        joined=[section[of] for section in joined_sections() for of in ("table", "figure")],
        diagnoses=[path for section in sections() for path in section["diagnoses"]],
        what_if=[section["what_if"] for section in sections() if section["what_if"]],
        provenance=paths.PROVENANCE,
        template=source("icpshap/report/page.html"),
    output:
        page=report(
            paths.REPORT,
            caption="../report/report.rst",
            category="Report",
            labels={"page": "the report on one page"},
        ),
        summary=paths.SUMMARY,
    log:
        "logs/report/report.log",
    benchmark:
        "logs/report/report.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code("report"),
        sections=sections(),
        joined=joined_sections(),
        titles=titles(),
    script:
        "../scripts/report.py"


rule checksums:
    """Checksums of all that the selected experiments made: sha256sum -c, years later."""
    input:
        targets(),
    output:
        paths.CHECKSUMS,
    log:
        "logs/checksums/checksums.log",
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code("checksums"),
    script:
        "../scripts/checksums.py"
