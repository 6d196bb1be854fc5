"""From pose samples and covariances to uncertainties and to what each cause contributes.

Outputs: results/{experiment}/{sequence}/{table}.parquet and results/{experiment}/{table}.parquet,
table one of pairs, fit, uncertainty, shap, directions, covariances, resampled
"""

TABLES = start.OF_EXPLANATION


rule explain_sequence:
    """Divergences of every setting and Shapley values of every instance of a sequence."""
    input:
        pairs=checks_of_pairs,
        fit=paths.FIT_NUMBERS,
        instances=lambda wildcards: [at(paths.INSTANCES, **dict(wildcards.items()))]
        * is_here(wildcards),
        runs=runs_of_sequence,
        estimates=estimates_of_sequence,
    output:
        **{table: at(paths.OF_SEQUENCE, table=table) for table in TABLES},
    log:
        "logs/explain_sequence/{experiment}/{sequence}.log",
    benchmark:
        "logs/explain_sequence/{experiment}/{sequence}.tsv"
    threads: 1
    resources:
        mem_mb=2000,
    params:
        plan=lambda wildcards: PLANS.explanation(wildcards.experiment, wildcards.sequence),
        jobs=lambda wildcards: PLANS.job_digests(wildcards.experiment, wildcards.sequence),
    script:
        "../scripts/explain_sequence.py"


rule join_sequences:
    """Put the sequences of an experiment into one table."""
    input:
        lambda wildcards: [
            at(paths.OF_SEQUENCE, **dict(wildcards.items()), sequence=sequence)
            for sequence in experiment_of(wildcards).pairs
        ],
    output:
        paths.OF_EXPERIMENT,
    log:
        "logs/join_sequences/{experiment}/{table}.log",
    benchmark:
        "logs/join_sequences/{experiment}/{table}.tsv"
    wildcard_constraints:
        table="|".join(TABLES),
    threads: 1
    params:
        plan=lambda wildcards: PLANS.joined(wildcards.experiment),
    script:
        "../scripts/join_sequences.py"
