"""Estimators: from a perturbed pair to pose samples."""
