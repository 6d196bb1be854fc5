"""What is no rigid transformation is told apart from what is one."""

import numpy as np
import pytest

from icpshap import rigid, se3

T = se3.exp(np.array([0.3, -0.2, 0.1, 1.0, 2.0, 3.0]))


def changed(row, column, value):
    result = T.copy()
    result[row, column] = value
    return result


def test_a_rigid_transformation_has_no_fault():
    assert rigid.fault(T) is None
    assert rigid.fault(T + 1e-6) is None  # as of a file with six decimals


@pytest.mark.parametrize(
    ("matrix", "problem", "hint"),
    [
        (T.T, "the last row of the matrix is", "transpose it: "),
        (changed(3, 3, 2.0), "expected [0, 0, 0, 1]", "row-major"),
        (T @ np.diag([1, 1, -1, 1]), "not a rotation but a reflection", "swapped"),
        (T @ np.diag([2, 2, 2, 1]), "it has the scale 2)", "same unit"),
        (changed(0, 0, 0.5), "differs from the identity by", "more decimals"),
        (T @ np.diag([1, 1, 0, 1]), "not a rotation (", "more decimals"),
    ],
)
def test_a_fault_says_what_it_is(matrix, problem, hint):
    found = rigid.fault(matrix)
    assert problem in found.problem and hint in found.hint
