"""From ICP runs to uncertainties and to what each uncertainty source contributes.

Outputs: results/{experiment}/{sequence}/{pairs,uncertainty,shap,resampled}.parquet,
results/{experiment}/{pairs,uncertainty,shap,resampled}.parquet
"""


rule explain_sequence:
    """Divergences of every setting and Shapley values of every instance of a sequence."""
    input:
        pairs=checks_of_pairs,
        runs=runs_of_pairs,
    output:
        pairs="results/{experiment}/{sequence}/pairs.parquet",
        uncertainty="results/{experiment}/{sequence}/uncertainty.parquet",
        shap="results/{experiment}/{sequence}/shap.parquet",
        resampled="results/{experiment}/{sequence}/resampled.parquet",
    log:
        "logs/explain_sequence/{experiment}/{sequence}.log",
    benchmark:
        "logs/explain_sequence/{experiment}/{sequence}.tsv"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        code=code_digest("explain_sequence"),
        seed=SETTINGS.seed,
        levels=lambda wildcards: experiment_of(wildcards).levels,
        method=lambda wildcards: estimator_of(wildcards).method,
    script:
        "../scripts/explain_sequence.py"


rule join_sequences:
    """Put the sequences of an experiment into one table."""
    input:
        lambda wildcards: [
            f"results/{wildcards.experiment}/{sequence}/{wildcards.table}.parquet"
            for sequence in experiment_of(wildcards).pairs
        ],
    output:
        "results/{experiment}/{table}.parquet",
    log:
        "logs/join_sequences/{experiment}/{table}.log",
    benchmark:
        "logs/join_sequences/{experiment}/{table}.tsv"
    wildcard_constraints:
        table="pairs|uncertainty|shap|resampled",
    threads: 1
    params:
        code=code_digest("join_sequences"),
    script:
        "../scripts/join_sequences.py"
