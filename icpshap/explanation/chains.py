"""How many independent samples the states of a Markov chain are worth."""

import numpy as np


def effective_sample_size(states: np.ndarray) -> float:
    """The smallest effective sample size of the coordinates of a chain's states (n, d), n >= 4.

    n / (1 + 2 sum of the autocorrelations), summed in pairs of lags as long as they are positive,
    each at most as large as the one before: Geyer, "Practical Markov Chain Monte Carlo", 1992,
    initial monotone sequence. A coordinate that does not move is worth one sample; alternating ones
    can be worth more than n.
    """
    centred = states - states.mean(axis=0)
    n = len(centred)
    spectrum = np.fft.rfft(centred, 2 * n, axis=0)
    covariance = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:n]
    return min(_size(of_coordinate) for of_coordinate in covariance.T)


def _size(covariance):
    """The effective sample size of one coordinate, from its autocovariances (n,)."""
    n = len(covariance)
    if not covariance[0] > 0:
        return 1.0
    correlation = covariance / covariance[0]
    pairs = correlation[: n - n % 2].reshape(-1, 2).sum(axis=1)
    positive = len(pairs) if (pairs > 0).all() else np.argmin(pairs > 0)
    time = 2 * np.minimum.accumulate(pairs[:positive]).sum() - 1
    return n / max(time, 1 / n)
