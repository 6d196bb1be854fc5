"""What is wrong with a pair of scans: measured, without ICP, against what is usual.

diagnostics: numbers of a pair; curves: how each cause changes them; verdict: which causes explain
what is unusual of a pair, at which level, and how sure that is.
"""
