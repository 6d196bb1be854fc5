"""From pose samples and covariances to uncertainties and to what each cause contributes.

Outputs: results/{experiment}/{sequence}/{table}.parquet and results/{experiment}/{table}.parquet,
table one of pairs, fit, uncertainty, shap, directions, covariances, resampled
"""

TABLES = start.OF_EXPLANATION


rule explain_sequence:
    """Divergences of every setting and Shapley values of every instance of a sequence."""
    input:
        pairs=checks_for(paths.PAIRS, pairs_of),
        fit=checks_for(paths.FIT_NUMBERS, pairs_of),
        instances=instances_of,
        runs=runs_of_sequence,
        estimates=estimates_of_sequence,
    output:
        **{table: at(paths.OF_SEQUENCE, table=table) for table in TABLES},
    log:
        "logs/explain_sequence/{experiment}/{sequence}.log",
    benchmark:
        "logs/explain_sequence/{experiment}/{sequence}.tsv"
    wildcard_constraints:
        experiment=before_many("explain_sequence"),
    threads: 1
    resources:
        mem_mb=growing(2000),
        runtime=time_of_explanation,
    params:
        plan=lambda wildcards: PLANS.explanation(wildcards.experiment, wildcards.sequence),
        jobs=lambda wildcards: PLANS.job_digests(wildcards.experiment, wildcards.sequence),
        checks=lambda wildcards: PLANS.check_digests(wildcards.experiment, wildcards.sequence),
    script:
        "../scripts/explain_sequence.py"


rule join_sequences:
    """Put the sequences of an experiment into one table of each kind."""
    input:
        **{table: tables_of_sequences(table) for table in TABLES},
    output:
        **{table: at(paths.OF_EXPERIMENT, table=table) for table in TABLES},
    log:
        "logs/join_sequences/{experiment}.log",
    benchmark:
        "logs/join_sequences/{experiment}.tsv"
    localrule: True
    threads: 1
    resources:
        mem_mb=1000,
    params:
        plan=lambda wildcards: PLANS.joined(wildcards.experiment),
    script:
        "../scripts/join_sequences.py"
