"""The ICP engine against an independent libpointmatcher, run by run (2,400 runs on a real pair)."""

import os
from pathlib import Path

import numpy as np
import pytest

from icpshap import icp

ORACLE = os.environ.get("ICPSHAP_ORACLE")
pytestmark = pytest.mark.skipif(not ORACLE, reason="ICPSHAP_ORACLE names no folder")

COALITIONS = ["000", "100", "010", "001", "110", "101", "011", "111"]
CHAINS = {
    "b": icp.Chain(),
    "c25": icp.Chain(),
    "d": icp.Chain(icp.PointToPoint(), matches=1, outlier_filter=icp.Trimmed(0.75)),
}


def load(name):
    return np.load(Path(ORACLE, name))


@pytest.fixture(scope="module")
def references():
    """The clean and the noisy reference, which share their lists between all regimes."""
    clouds = [load(f"P1_{kind}.npy").astype(float) for kind in ("clean", "noisy")]
    return [icp.Reference(cloud[icp.minimum_range(cloud, 1.0)]) for cloud in clouds]


@pytest.mark.parametrize(
    "regime",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in ("b", "d"))) for name in CHAINS],
)
def test_same_poses_and_iterations_run_by_run(regime, references):
    inputs, expected = load("inputs.npz"), load(f"poses_{regime}_f64.npz")
    masks = np.unpackbits(inputs["mask25_packed"], axis=1)[:, : len(inputs["P2_keep"])].astype(bool)
    for row, coalition in enumerate(COALITIONS):
        noisy, spread, reduced = (int(on) for on in coalition)
        source = load(f"P2_{('clean', 'noisy')[noisy]}.npy").astype(float)
        usable = icp.minimum_range(source, 1.0)
        if reduced:
            usable &= inputs["P2_keep"]
        used = usable & masks if regime == "c25" else np.tile(usable, (100, 1))
        result = icp.register(
            references[noisy],
            source,
            [np.flatnonzero(run) for run in used],
            inputs[("T_init_s1", "T_init_s15")[spread]],
            CHAINS[regime],
        )
        np.testing.assert_allclose(
            result.T_reference_source, expected["T"][row], rtol=0, atol=1e-9, err_msg=coalition
        )
        np.testing.assert_array_equal(result.iterations, expected["iters"][row])


@pytest.mark.parametrize("kind", ["clean", "noisy"])
def test_same_normals(kind, references):
    """Up to sign, wherever the seven neighbours single out a direction."""
    expected = load("reference_normals_f64.npz")[f"normals_{kind}"]
    reference = references[("clean", "noisy").index(kind)]
    cosine = np.einsum("ij,ij->i", reference.normals, expected[reference.tree.rows])
    assert np.quantile(1 - np.abs(cosine), 0.999) < 1e-9
