"""A folder of pairs of a corridor: one is noisy, of one a part of the source is hidden."""

import corridors
import numpy as np

PAIRS = 6
NOISY, HIDDEN = 1, 4
SIGMA = 0.05  # m


def write(folder):
    """Scans 2k and 2k + 1 of pair k, and poses."""
    folder.mkdir(parents=True)
    generator = np.random.default_rng(7)
    poses = []
    for place in range(PAIRS):
        pair = corridors.pair(place)
        reference, source = pair.reference, pair.source
        if place == NOISY:
            reference, source = (
                cloud + generator.normal(0, SIGMA, cloud.shape) for cloud in (reference, source)
            )
        if place == HIDDEN:
            source = source[source[:, 1] < 0.5]
        for index, cloud in ((2 * place, reference), (2 * place + 1, source)):
            np.savetxt(folder / f"scan_{index:02d}.xyz", cloud)
        poses += [np.eye(4), pair.T_reference_source]
    np.savetxt(folder / "poses.txt", np.array(poses)[:, :3].reshape(-1, 12))
