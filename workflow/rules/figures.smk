"""Figures."""


def figures_of(experiment, scope):
    return []
