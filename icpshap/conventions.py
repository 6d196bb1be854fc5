"""A covariance of a pose in the order and the axes of other programs.

Ours (..., 6, 6) [rad, m] is of xi = [rotation; translation], where a pose is T_reference_source
exp(xi): in the axes of the source. It is the covariance of the tangent vector of gtsam.Pose3.
"""

import numpy as np

SWAP = np.roll(np.eye(6), 3, axis=0)  # from rotation first to translation first, and back


def ros(covariance: np.ndarray, T_reference_source: np.ndarray) -> np.ndarray:
    """That of geometry_msgs/PoseWithCovariance, of the source's pose in the reference [m, rad].

    covariance (..., 6, 6), T_reference_source (4, 4). Translation first, along the reference's
    axes, then the turn about these fixed axes.

    >>> quarter_turn = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    >>> np.diagonal(ros(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), quarter_turn)).tolist()
    [5.0, 4.0, 6.0, 2.0, 1.0, 3.0]
    """
    turn = np.kron(np.eye(2), T_reference_source[:3, :3])
    return _of_product(SWAP @ turn, covariance)


def g2o(covariance: np.ndarray) -> np.ndarray:
    """That of the error of g2o's EDGE_SE3:QUAT: translation [m], vector part of a quaternion [-].

    covariance (..., 6, 6), as what is returned. Such a part is half of a small turn. The edge's
    error is that of the true motion against the measured one, -xi, of which the covariance is the
    same.
    """
    halved = np.diag(np.repeat([1.0, 0.5], 3))
    return _of_product(halved @ SWAP, covariance)


def translation_first(covariance: np.ndarray) -> np.ndarray:
    """The same (..., 6, 6) with the translation first [m, rad].

    >>> np.diagonal(translation_first(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))).tolist()
    [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]
    """
    return _of_product(SWAP, covariance)


def _of_product(matrix, covariance):
    """The covariance of matrix (6, 6) times what `covariance` is of, symmetric to the bit."""
    product = matrix @ covariance @ matrix.T
    return (product + np.swapaxes(product, -1, -2)) / 2
