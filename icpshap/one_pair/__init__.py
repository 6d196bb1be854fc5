"""One pair of scans in one process: what is given, the recipe, what comes back, and its screen."""
