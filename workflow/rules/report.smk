"""Tables for people, and the report.

Outputs: results/{scope}/tables/median_shap.{csv,md,tex}, results/{scope}/tables/outlier_rules.csv,
where {scope} is an experiment or one sequence of it
"""


rule median_table:
    """Rank the uncertainty sources of each sequence, beside the paper's Table 1."""
    input:
        shap="results/{scope}/shap.parquet",
        resampled="results/{scope}/resampled.parquet",
        paper="reference/table1.csv",
    output:
        md="results/{scope}/tables/median_shap.md",
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
