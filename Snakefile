"""Why is this registration uncertain? The experiment of the paper, from scans to explanations.

snakemake -j2                                       the whole experiment on the real data
snakemake -j2 --configfile config/demo.yaml         both experiments on simulated scans, offline
snakemake -j2 --config 'sequences=[stairs]'         one sequence
"""


include: "workflow/Snakefile"


# Else none is: what an included file says of it does not count.
workflow.default_target = "all"
