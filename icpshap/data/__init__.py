"""Scans and poses: found, read, checked, simulated."""
