"""Report."""


def tables_of(scope):
    return []
