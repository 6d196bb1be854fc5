"""The closed form: against an independent program, against Monte Carlo, and its own promises."""

import numpy as np
import pytest
import threadpoolctl
from estimated_room import DEVIATION, STREAMS, covariances, estimate, estimator, flat, setting
from oracle_pair import COALITIONS, PLANES, POINTS, OraclePair, relative_error
from scipy.spatial import cKDTree

from icpshap import icp, se3
from icpshap.causes import CAUSES
from icpshap.estimators import closed_form, perturb
from icpshap.tables import COVARIANCE, TRANSFORM

CHAINS = {"plane": PLANES, "point": POINTS}
CLOUDS = ("source", "reference")
TO_THE_LAST_BITS = 1e-12


def moved_right(left, T):
    """A covariance of eta in exp(eta) T, of xi in T exp(xi)."""
    adjoint = se3.adjoint(se3.inverse(T))
    return adjoint @ left @ adjoint.T


# --- the oracle -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def references():
    return {}


@pytest.fixture
def linearise(oracle, references):
    """Links and closed form of a coalition at a pose, with unit noise."""
    pair = OraclePair(oracle)

    def of(coalition, T, chain):
        noisy = coalition[0]
        if noisy not in references:
            references[noisy] = icp.Reference(pair.reference(coalition))
        reference, source = references[noisy], pair.source(coalition)
        unit = np.ones(len(source)), np.ones(len(reference))
        found = {
            links: closed_form.of_clouds(reference, source, T, chain, *unit, links)
            for links in ("shared", "independent")
        }
        return closed_form.kept_links(reference, source, T, chain), found

    return of


@pytest.mark.parametrize("metric", CHAINS)
def test_links_and_covariances_are_those_of_the_oracle(linearise, estimator_oracle, metric):
    expected = np.load(estimator_oracle / "censi.npz")
    rows = np.load(estimator_oracle / "censi_links.npz")
    for k, coalition in enumerate(COALITIONS):
        T = expected[f"T_{metric}"][k]
        links, found = linearise(coalition, T, CHAINS[metric])
        assert links.number == expected[f"n_links_{metric}"][k]
        assert links.squared_error == pytest.approx(
            expected[f"rss_{metric}"][k], rel=TO_THE_LAST_BITS
        )
        for mode, by in found.items():
            of_oracle = moved_right(expected[f"{metric}_gn_{mode}"][k], T)
            assert relative_error(by.covariance, of_oracle) < TO_THE_LAST_BITS, (coalition, mode)
        if f"{metric}_source_{coalition}" in rows:
            ours = np.stack([np.nonzero(links.kept)[0], links.reference[links.kept]])
            theirs = np.stack([rows[f"{metric}_{cloud}_{coalition}"] for cloud in CLOUDS])
            np.testing.assert_array_equal(
                *(pairs[:, np.lexsort(pairs)] for pairs in (ours, theirs))
            )


def test_the_chain_rests_where_the_oracle_does(oracle, estimator_oracle):
    expected, pair = np.load(estimator_oracle / "censi.npz"), OraclePair(oracle)
    for k, coalition in enumerate(COALITIONS):
        if coalition[1] == "1":
            continue
        source = pair.source(coalition)
        for metric, chain in CHAINS.items():
            found = icp.register(
                icp.Reference(pair.reference(coalition)),
                source,
                [np.arange(len(source))],
                pair.T_true[None],
                chain,
            )
            np.testing.assert_allclose(
                found.T_reference_source[0], expected[f"T_{metric}"][k], atol=1e-9
            )
            assert found.iterations[0] == expected[f"it_{metric}"][k]


def test_the_released_covariance_is_that_of_independent_links(linearise, oracle, estimator_oracle):
    """Theirs scales the rotation rows by |p| (a leftover), and stays in the centred frame."""
    expected, pair = np.load(estimator_oracle / "censi.npz"), OraclePair(oracle)
    for k, coalition in enumerate(COALITIONS[:2]):
        T, mean = expected["T_plane"][k], expected["reference_mean"][k]
        links, _ = linearise(coalition, T, PLANES)
        rows = links.reference[links.kept]
        normals = links.normals[rows] @ T[:3, :3].T
        p = se3.transform(T, links.points)[np.nonzero(links.kept)[0]] - mean
        q = se3.transform(expected["step_plane"][k], pair.reference(coalition)[rows] - mean)
        lengths = np.linalg.norm(p, axis=1, keepdims=True)
        features = np.concatenate([lengths * np.cross(q, normals), normals], axis=1)
        found = 2 * np.linalg.inv(features.T @ features)
        assert relative_error(found, expected["released_censi_centred"][k]) < TO_THE_LAST_BITS


def test_the_bias_is_that_of_the_oracle_with_its_signs_of_the_normals(
    linearise, oracle, estimator_oracle
):
    """The signs of an eigenvector are arbitrary, and decide the bias: ours look to the scanner."""
    expected, pair = np.load(estimator_oracle / "censi.npz"), OraclePair(oracle)
    for k, coalition in enumerate(COALITIONS[:2]):
        T = expected["T_plane"][k]
        links, found = linearise(coalition, T, PLANES)
        points = pair.reference(coalition)
        neighbours = points[cKDTree(points).query(points, 7)[1]]
        neighbours -= neighbours.mean(axis=1, keepdims=True)
        scatter = np.einsum("nka,nkb->nab", neighbours, neighbours)
        normals = np.linalg.eigh(scatter)[1][:, :, 0]
        theirs = links._replace(normals=normals @ T[:3, :3])
        matrix = closed_form.information(
            closed_form.homogeneous(links.points), closed_form.link_weights(theirs)
        )
        b = np.linalg.solve(matrix, closed_form.normal_sum(theirs))
        of_oracle = moved_right(expected["bias_outer_gn"][k], T)
        assert relative_error(2 * np.outer(b, b), of_oracle) < TO_THE_LAST_BITS
        assert np.linalg.matrix_rank(found["shared"].bias, hermitian=True) == 1


# --- Monte Carlo and formulas ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def at_truth(room_pair):
    """Reference, source points, true pose of the room."""
    return icp.Reference(room_pair.reference, 12), room_pair.source[:400], room_pair


@pytest.mark.parametrize("metric", CHAINS)
def test_it_is_the_spread_under_fresh_noise_where_matches_are_held(at_truth, metric):
    """Noise of each point, and a least-squares step out of links and normals that do not change."""
    reference, points, pair = at_truth
    T = pair.T_reference_source
    links = closed_form.kept_links(reference, points, T, CHAINS[metric])
    source, _ = np.nonzero(links.kept)
    row = links.reference[links.kept]
    generator = np.random.default_rng(5)
    sigma = generator.uniform(0.005, 0.02, len(points)), generator.uniform(0.01, 0.03, 3000)
    draws = 4000
    xi = np.empty((draws, 6))
    jacobian = np.zeros((len(points), 3, 6))
    jacobian[:, :, :3], jacobian[:, :, 3:] = -se3.hat(points), np.eye(3)
    rows = jacobian[source]
    if metric == "plane":
        rows = np.einsum("la,lax->lx", links.normals[row], rows)
    step = np.linalg.pinv(rows.reshape(-1, 6))
    for k in range(draws):
        moved = sigma[0][:, None] * generator.standard_normal((len(points), 3))
        other = sigma[1][:, None] * generator.standard_normal((3000, 3))
        residual = moved[source] - other[row]
        if metric == "plane":
            residual = np.einsum("la,la->l", links.normals[row], residual)
        xi[k] = -step @ residual.ravel()
    found = closed_form.of_clouds(
        reference, points, T, CHAINS[metric], sigma[0] ** 2, sigma[1] ** 2, "shared"
    )
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), xi.std(axis=0), rtol=0.05)
    whitened = np.linalg.solve(np.linalg.cholesky(found.covariance), xi.T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(6), atol=0.12)


def test_independent_links_are_the_shared_ones_of_one_match_and_another_point_each(at_truth):
    """With one match a source point has one link; only what shares a reference point differs."""
    reference, points, pair = at_truth
    chain = icp.Chain(matches=1, outlier_filter=icp.Trimmed(1.0))
    given = (reference, points, pair.T_reference_source, chain, np.ones(400), np.zeros(3000))
    shared, independent = (
        closed_form.of_clouds(*given, links) for links in ("shared", "independent")
    )
    np.testing.assert_allclose(shared.covariance, independent.covariance, rtol=1e-9)


def test_f_of_noise_follows_the_formula(at_truth):
    """C = s^2 G, so that f = 3 (1/rho - 1 + ln rho) with rho the ratio of the variances."""
    reference, points, pair = at_truth
    clean, noisy = (
        closed_form.of_clouds(
            reference, points, pair.T_reference_source, PLANES,
            np.full(400, variance), np.full(3000, variance),
        ).covariance
        for variance in (0.01**2, 0.01**2 + 0.05**2)
    )  # fmt: skip
    rho = 1 + (0.05 / 0.01) ** 2
    solved = np.linalg.solve(noisy, clean)
    f = 0.5 * (np.trace(solved) - 6 - np.linalg.slogdet(solved)[1])
    assert f == pytest.approx(3 * (1 / rho - 1 + np.log(rho)), rel=1e-9)


def test_residuals_of_planes_give_the_variance_of_both_clouds():
    """Noise of the source alone, so that each cloud is said to have half of its variance."""
    source = flat(2000, 1) + np.random.default_rng(0).normal(0, 0.01, (2000, 3))
    chain = icp.Chain(outlier_filter=icp.Trimmed(1.0))
    links = closed_form.kept_links(icp.Reference(flat(2000, 0)), source, np.eye(4), chain)
    assert 2 * closed_form.residual_variance(links) == pytest.approx(0.01**2, rel=0.1)


def test_residuals_of_points_give_the_variance_of_both_clouds():
    """Points so far apart that each finds its own."""
    points = np.stack(np.meshgrid(*[np.arange(1.0, 11.0)] * 3), axis=-1).reshape(-1, 3)
    noise = np.random.default_rng(0).normal(0, 0.01, (2, *points.shape))
    chain = icp.Chain(icp.PointToPoint(), matches=1, outlier_filter=icp.Trimmed(1.0))
    reference = icp.Reference(points + noise[0])
    links = closed_form.kept_links(reference, points + noise[1], np.eye(4), chain)
    assert closed_form.residual_variance(links) == pytest.approx(0.01**2, rel=0.1)


# --- the kind -------------------------------------------------------------------------------------


def test_the_initial_pose_changes_nothing_at_all(room_pair):
    values = [(0.02, 1.0, 0.1), (0.02, 1.5, 0.1), (0.02, 9.0, 0.1)]
    table = estimate(room_pair, values)
    first, *others = table[COVARIANCE + TRANSFORM].to_numpy()
    assert all(np.array_equal(first, other) for other in others)


@pytest.mark.parametrize("noise", ["known", "fixed", "residuals"])
def test_it_is_told_the_noise_or_not(room_pair, noise):
    """Of its own clouds at its own pose, with the variance that the option says."""
    given = {"noise": noise, "sensor_sigma": 0.02}
    (row,) = estimate(room_pair, [(0.05, 1.0, 0.0)], **given).itertuples()
    (found,) = covariances(estimate(room_pair, [(0.05, 1.0, 0.0)], **given))
    T = np.array([getattr(row, name) for name in TRANSFORM]).reshape(4, 4)
    of_kind = estimator(**given)
    (group,) = perturb.groups(room_pair, [setting(0.05, 1.0, 0.0)], of_kind, DEVIATION, STREAMS)
    points = next(group.starts).source
    reference, chain = icp.Reference(group.reference, 12), of_kind.kind.chain()
    links = closed_form.kept_links(reference, points, T, chain)
    variance = {
        "known": 0.05**2 + 0.02**2,
        "fixed": 0.02**2,
        "residuals": links.squared_error / (2 * (links.number - 6)),
    }[noise]
    unit = np.ones(len(points)), np.ones(len(reference))
    expected = variance * closed_form.of_clouds(reference, points, T, chain, *unit).covariance
    assert relative_error(found, expected) < 1e-9
    assert row.rmse == pytest.approx(np.sqrt(links.squared_error / links.number))


def test_the_seam_says_how_noisy_each_point_is(room_pair):
    """As the noise that the cause draws, with a scanner's model, and twice on the reference."""
    of_kind = estimator(sensor="sick_lms_1xx", reference_noise_additions=2)
    noisy, clean = setting(2.0, 1.0, 0.0), setting(0.0, 1.0, 0.0)
    (group,) = perturb.groups(room_pair, [noisy], of_kind, DEVIATION, STREAMS)
    (start,) = group.starts
    for points, variance, additions in (
        (start.source, start.source_variance, 1),
        (group.reference, group.reference_variance, 2),
    ):
        ranges = np.linalg.norm(points, axis=1)
        sigma = 2.0 * np.maximum(0.012, 0.0068 * ranges + 0.0008)
        np.testing.assert_allclose(variance, additions * sigma**2)
    (group,) = perturb.groups(room_pair, [clean], of_kind, DEVIATION, STREAMS)
    assert not group.reference_variance.any()
    assert not next(group.starts).source_variance.any()


def test_a_point_of_less_noise_counts_for_less(room_pair):
    """A scanner's noise grows with the range: its covariance is not that of the mean variance."""
    (found,) = covariances(estimate(room_pair, [(1.0, 1.0, 0.0)], sensor="sick_lms_1xx"))
    (same,) = covariances(estimate(room_pair, [(0.02, 1.0, 0.0)]))
    assert np.linalg.cond(np.linalg.solve(same, found)) > 1.05


def test_causes_that_a_linearisation_cannot_see_are_not_its_own():
    unseen = set(CAUSES) - set(closed_form.ClosedForm.sees)
    assert {"range_bias", "motion_distortion"} <= unseen


@pytest.mark.parametrize("links", ["shared", "independent"])
def test_the_number_of_threads_changes_no_byte(at_truth, links):
    reference, _, pair = at_truth
    unit = np.ones(len(pair.source)), np.ones(len(reference))
    given = (reference, pair.source, pair.T_reference_source, PLANES, *unit, links)
    found = set()
    for threads in (1, 2):
        with threadpoolctl.threadpool_limits(threads):
            found.add(closed_form.of_clouds(*given).covariance.tobytes())
    assert len(found) == 1


# --- failures -------------------------------------------------------------------------------------


def test_a_plane_alone_is_degenerate():
    found = closed_form.of_clouds(
        icp.Reference(flat(500, 0)), flat(300, 1), np.eye(4), PLANES, np.ones(300), np.ones(500)
    )
    assert found.status == "degenerate"
    assert np.isnan(found.covariance).all()
    assert found.links > closed_form.FEWEST_LINKS


@pytest.mark.parametrize(
    ("points", "status"), [(0, "too_few_links"), (6, "too_few_links"), (7, "ok")]
)
def test_seven_links_are_enough(at_truth, points, status):
    reference, source, pair = at_truth
    chain = icp.Chain(matches=1, outlier_filter=icp.Trimmed(1.0))
    # One on each wall, then more.
    given = source[:points], pair.T_reference_source, chain, np.ones(points), np.ones(3000)
    found = closed_form.of_clouds(reference, *given)
    assert found.status == status
    assert np.isfinite(found.covariance).all() == (status == "ok")


def test_links_beyond_the_maximum_distance_are_none(at_truth):
    reference, points, pair = at_truth
    far = pair.T_reference_source @ se3.exp([0, 0, 0, 50.0, 0, 0])
    chain = icp.Chain(maximum_distance=1.0)
    found = closed_form.of_clouds(reference, points, far, chain, np.ones(400), np.ones(3000))
    assert (found.status, found.links, found.inlier_ratio) == ("too_few_links", 0, 0.0)


def test_a_failed_registration_is_the_estimates_status(room_pair):
    table = estimate(room_pair, [(0.0, 1.0, 0.0)], maximum_distance=1e-9)
    assert table["status"].tolist() == ["too_few_links"]
    assert table[COVARIANCE].isna().all(axis=None)
