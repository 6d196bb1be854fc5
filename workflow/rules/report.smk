"""Tables for people, the comparison with the paper, and the report.

Outputs: results/{scope}/tables/median_shap.{csv,md,tex}, results/{scope}/tables/outlier_rules.csv,
where {scope} is an experiment or one sequence of it; and, for all that was selected,
results/comparison/paper.{csv,md,png,svg}, results/provenance.yaml, results/{report.html,summary.txt}
"""


report: "../report/workflow.rst"


rule median_table:
    """Rank the uncertainty sources of each sequence, beside the paper's Table 1."""
    input:
        shap="results/{scope}/shap.parquet",
        resampled="results/{scope}/resampled.parquet",
        paper=f"{workflow.basedir}/reference/table1.csv",
    output:
        md=report(
            "results/{scope}/tables/median_shap.md",
            caption="../report/median_table.rst",
            category="{scope}",
            subcategory="Tables",
            labels={"table": "median Shapley values"},
        ),
        csv="results/{scope}/tables/median_shap.csv",
        tex="results/{scope}/tables/median_shap.tex",
        rules="results/{scope}/tables/outlier_rules.csv",
    log:
        "logs/median_table/{scope}.log",
    benchmark:
        "logs/median_table/{scope}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=code_digest("median_table"),
        study=study_of,
        seed=SETTINGS.seed,
    script:
        "../scripts/median_table.py"


rule compare_with_paper:
    """Set the results of every estimator that was run against the paper's."""
    input:
        files_of(compared_sections(), "shap"),
        figures=f"{workflow.basedir}/reference/figures.csv",
    output:
        png=report(
            "results/comparison/paper.png",
            caption="../report/figure.rst",
            category="Against the paper",
            labels={"figure": "ours against the paper"},
        ),
        svg="results/comparison/paper.svg",
        caption="results/comparison/paper.txt",
        csv="results/comparison/paper.csv",
        md="results/comparison/paper.md",
    log:
        "logs/compare_with_paper/paper.log",
    benchmark:
        "logs/compare_with_paper/paper.tsv"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("compare_with_paper"),
        sections=compared_sections(),
        titles=titles(),
    script:
        "../scripts/compare_with_paper.py"


rule provenance:
    """Write down what the selected experiments were made with."""
    input:
        files_of(sections(), "uncertainty", "shap", "pairs"),
    output:
        "results/provenance.yaml",
    log:
        "logs/provenance/provenance.log",
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("provenance"),
        config=config,
        commit=record.commit(workflow.basedir),
        root=workflow.basedir,
        sequences={key: SETTINGS.data[key].kind for key in SETTINGS.sequences},
    script:
        "../scripts/provenance.py"


rule report:
    """Make the report of the selected experiments, and the few lines that end a run."""
    input:
        files_of(sections(), "shap", "uncertainty", "pairs"),
        # Both or none: where no selected sequence is of the paper, there is nothing to compare.
        compared=[
            f"results/comparison/paper.{kind}" for kind in ("csv", "svg") if compared_sections()
        ],
        provenance="results/provenance.yaml",
        template=f"{workflow.basedir}/icpshap/report/page.html",
    output:
        page=report(
            "results/report.html",
            caption="../report/report.rst",
            category="Report",
            labels={"page": "the report on one page"},
        ),
        summary="results/summary.txt",
    log:
        "logs/report/report.log",
    benchmark:
        "logs/report/report.tsv"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("report"),
        sections=sections(),
        titles=titles(),
    script:
        "../scripts/report.py"
