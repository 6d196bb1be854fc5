"""Local rules for jobs of few pairs or settings, by icpshap/jobs/few.py.

Outputs, and logs: those of the rules that they are made from
"""


use rule check_pairs as check_few_pairs with:
    wildcard_constraints:
        experiment=before_few("check_pairs"),
    localrule: True


use rule diagnose_pairs as diagnose_few_pairs with:
    wildcard_constraints:
        experiment=before_few("diagnose_pairs"),
    localrule: True


use rule find_instances as find_few_instances with:
    wildcard_constraints:
        experiment=before_few("find_instances"),
    localrule: True


use rule explain_sequence as explain_few_settings with:
    wildcard_constraints:
        experiment=before_few("explain_sequence"),
    localrule: True
