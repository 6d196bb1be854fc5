"""Faults that are done to the workflow on purpose, and what comes of each; see `__main__`."""
