"""Bayesian quadrature: the printed equations, an independent Gaussian-process library, known gradients, faults."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tinygp
from jax.test_util import check_grads

from srl_jax.bayes import quadrature

monte_carlo, model1, model2 = map(jax.jit, (quadrature.monte_carlo, quadrature.model1, quadrature.model2))
natural = jax.jit(quadrature.natural)
MODELS = {"model1": model1, "model2": model2}
ESTIMATORS = {"monte_carlo": monte_carlo, **MODELS}
BANDIT = jnp.diag(jnp.array([1.0, 2.0]))  # Fisher information of N(0, 1) in its mean and log-scale
N = 3


def data(count: int, size: int = N, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size, size)) + 2 * np.eye(size)
    return rng.normal(size=(count, size)) @ root.T, rng.normal(size=count), root @ root.T


def bandit_scores(actions: jax.Array) -> jax.Array:
    return jnp.stack([actions, actions**2 - 1.0], axis=1)


def printed(estimator, U, R, G, noise):
    """The equations as printed, with every matrix formed: U is f[n, M]."""
    size, count = U.shape
    kernel = U.T @ np.linalg.inv(G) @ U
    if estimator is model2:
        C = np.linalg.inv(kernel + noise * np.eye(count))
        return U @ C @ R, G - U @ C @ U.T
    C = np.linalg.inv((1 + kernel) ** 2 + noise * np.eye(count))
    b = 1 + np.diag(kernel)
    return (U * R) @ C @ b, (1 + size - b @ C @ b) * np.eye(size)


@pytest.mark.parametrize("estimator", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("count", [1, 9, 10, 40])  # on both sides of n, and of the ten features of model 1
def test_models_equal_their_printed_equations(estimator, count, x64):
    U, R, G = data(count)
    found = estimator(U, R, G, noise=0.3, scale=1.0)
    mean, covariance = printed(estimator, U.T, R, G, 0.3)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7, atol=1e-9)
    scaled = estimator(U, R, G, noise=0.6, scale=2.0)
    np.testing.assert_allclose(scaled.mean, mean, rtol=1e-8)
    np.testing.assert_allclose(scaled.covariance, 2 * covariance, rtol=1e-7, atol=1e-9)


def test_monte_carlo_is_the_sample_mean_with_its_sampling_covariance(x64):
    U, R, _ = data(7)
    found = monte_carlo(U, R)
    np.testing.assert_allclose(found.mean, (U * R[:, None]).mean(0))
    np.testing.assert_allclose(found.covariance, np.cov((U * R[:, None]).T) / 7)
    alone = monte_carlo(U[:1], R[:1])
    np.testing.assert_allclose(alone.covariance, np.outer(U[0], U[0]) * R[0] ** 2)


@pytest.mark.parametrize("estimator", MODELS.values(), ids=MODELS)
def test_models_are_the_integral_of_a_gaussian_process(estimator, x64):
    """A GP library gives the process's posterior on the nodes of a quadrature rule, and the rule integrates it."""
    nodes, mass = np.polynomial.hermite_e.hermegauss(20)
    mass = mass / mass.sum()
    root = np.sqrt([1.0, 2.0])
    actions = np.random.default_rng(1).normal(size=12)
    returns = np.sin(2 * actions)
    U, at = (np.stack([a, a**2 - 1.0], axis=1) for a in (actions, nodes))
    one = estimator is model1
    kernel = tinygp.kernels.Polynomial(order=2, sigma=1.0) if one else tinygp.kernels.DotProduct()

    @jax.jit
    def condition(y):
        posterior = tinygp.GaussianProcess(kernel, U / root, diag=0.1).condition(y, at / root).gp
        return posterior.loc, posterior.covariance

    posteriors = [condition(y) for y in ((U * returns[:, None]).T if one else [returns])]
    if one:
        mean = [mass @ loc for loc, _ in posteriors]
        covariance = [mass @ spread @ mass for _, spread in posteriors] * np.eye(2)
    else:
        (loc, spread), rule = posteriors[0], (mass[:, None] * at).T
        mean, covariance = rule @ loc, rule @ spread @ rule.T
    found = estimator(U, returns, BANDIT, noise=0.1)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(("count", "noise"), [(10, 0.5), (100, 3.0)])
def test_model_2_with_the_empirical_fisher_is_shrunken_monte_carlo(count, noise):
    U, R, _ = data(count)
    fisher = quadrature.estimate_fisher(jnp.asarray(U, jnp.float32), 0.0)
    found = model2(U, R, fisher, noise=noise).mean
    plain = monte_carlo(U, R).mean
    np.testing.assert_allclose(found, plain * count / (count + noise), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("estimator", MODELS.values(), ids=MODELS)
def test_covariance_is_symmetric_and_shrinks_with_data(estimator, x64):
    U, R, G = data(25)
    before = G if estimator is model2 else (1 + N) * np.eye(N)
    for count in (2, 11, 25):
        after = np.asarray(estimator(U[:count], R[:count], G, noise=0.1).covariance)
        np.testing.assert_allclose(after, after.T, rtol=1e-10)
        assert np.linalg.eigvalsh(after).min() > 0
        assert np.linalg.eigvalsh(before - after).min() > -1e-9, f"{count} trajectories know less than fewer"
        before = after
    assert np.trace(before) < 0.05 * np.trace(G)


@pytest.mark.parametrize("power", [1, 2])
def test_the_bandit_with_100_samples(power):
    """Policy N(0, 1), rewards a and a^2: exact gradients (1, 0) and (0, 2); Monte-Carlo misses them by tenths."""
    exact = np.eye(2)[power - 1] * power
    actions = jax.random.normal(jax.random.key(0), (30, 100))
    run = lambda estimator: jax.vmap(  # noqa: E731
        lambda a: estimator(bandit_scores(a), a**power, BANDIT, noise=1e-4).mean
    )(actions)
    np.testing.assert_allclose(run(model1), np.tile(exact, (30, 1)), atol=1e-4)
    assert np.abs(np.asarray(run(monte_carlo)) - exact).max() > 0.1
    if power == 1:  # a reward in the span of the scores is all that model 2 learns at once
        np.testing.assert_allclose(run(model2), np.tile(exact, (30, 1)), atol=1e-4)


def test_natural_gradient_of_model_2_is_the_regression_of_returns_on_scores(x64):
    U, _, G = data(20)
    weights = np.array([1.0, -2.0, 0.5])
    gradient = model2(U, U @ weights, G, noise=0.0)
    np.testing.assert_allclose(natural(gradient, G).mean, weights, rtol=1e-6)
    noisy = natural(model2(U, U @ weights, G, noise=1.0), G)
    np.testing.assert_allclose(noisy.covariance, np.linalg.inv(U.T @ U + G), rtol=1e-6)


def test_estimated_fisher_has_full_rank_and_the_trace_of_the_scores():
    U = jnp.asarray(data(2, 5)[0], jnp.float32)
    fisher = quadrature.estimate_fisher(U, 0.1)
    assert np.linalg.eigvalsh(fisher).min() > 0
    assert np.trace(fisher) == pytest.approx(np.sum(np.square(U)) / 2, rel=1e-5)
    assert model2(U, jnp.ones(2)).ok


@pytest.mark.parametrize("estimator", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("count", [6, 12])
def test_means_are_differentiable(estimator, count, x64):
    U, R, G = data(count)
    check_grads(lambda u, r: estimator(u, r, G, noise=0.3).mean, (U, R), order=1, modes=["rev"], rtol=1e-5)


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_float32_at_the_largest_size_agrees_with_float64(estimator):
    U, _, G = data(2000, 100)
    R = U @ np.linspace(-1, 1, 100)
    with jax.enable_x64(True):
        exact = jax.device_get(estimator(U, R, G, noise=1.0))
    found = estimator(*(jnp.asarray(x, jnp.float32) for x in (U, R, G)), noise=1.0)
    assert found.ok and found.mean.dtype == jnp.float32 and exact.mean.dtype == np.float64
    np.testing.assert_allclose(found.mean, exact.mean, atol=2e-3 * np.abs(exact.mean).max())


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
def test_a_lane_sees_no_other_lane_and_a_faulty_one_is_flagged(estimator):
    batches = [data(12, seed=seed)[:2] for seed in range(3)]
    U, R = (np.stack(part).astype(np.float32) for part in zip(*batches, strict=True))
    run = jax.vmap(lambda u, r: estimator(u, r, noise=0.1))
    before = run(U, R)
    spoilt = R.copy()  # jax may still read R
    spoilt[1, 3] = np.nan
    after = run(U, spoilt)
    assert before.ok.all() and after.ok.tolist() == [True, False, True]
    np.testing.assert_array_equal(after.mean[1], np.zeros(N))
    np.testing.assert_array_equal(after.covariance[1], np.eye(N))
    np.testing.assert_array_equal(after.mean[::2], before.mean[::2])
    np.testing.assert_array_equal(after.covariance[::2], before.covariance[::2])
    np.testing.assert_allclose(before.mean[2], estimator(U[2], R[2], noise=0.1).mean, rtol=1e-4, atol=1e-5)


FAULTS = {
    "singular": (np.diag([1.0, 0.0, 1.0]), {}),
    "rounding": (np.array([[1.0, 1.0, 0.0], [1.0, 1.0 + 2.4e-7, 0.0], [0.0, 0.0, 1.0]], np.float32), {}),
    "indefinite": (np.diag([1.0, -1.0, 1.0]), {}),
    "not finite": (np.full((N, N), np.nan), {}),
    "negative noise": (np.eye(N), {"noise": -1e-3}),
    "no scale": (np.eye(N), {"scale": 0.0}),
}


@pytest.mark.parametrize("estimator", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_flagged_not_raised(estimator, fault):
    U, R, _ = data(12)
    fisher, options = FAULTS[fault]
    found = estimator(U, R, fisher, **options)
    assert not found.ok and np.all(found.mean == 0) and np.all(found.covariance == np.eye(N))


def test_singular_fisher_flags_the_natural_gradient_and_small_units_do_not():
    gradient = quadrature.Gradient(jnp.ones(2), jnp.eye(2), jnp.array(True))
    assert not natural(gradient, jnp.diag(jnp.array([1.0, 0.0]))).ok
    assert natural(gradient, jnp.diag(jnp.array([1.0, 1e-12]))).ok, "a unit of 1e-6 is no singularity"


@pytest.mark.parametrize("estimator", ESTIMATORS.values(), ids=ESTIMATORS)
@pytest.mark.parametrize(
    ("scores", "returns", "fisher", "name"),
    [
        ((0, 2), (0,), None, "scores"),
        ((5, 0), (5,), None, "scores"),
        ((5,), (5,), None, "scores"),
        ((5, 2), (4,), None, "returns"),
        ((5, 2), (5, 1), None, "returns"),
        ((5, 2), (5,), (3, 3), "fisher"),
        ((5, 2), (5,), (2,), "fisher"),
    ],
)
def test_wrong_shapes_are_refused_by_name(estimator, scores, returns, fisher, name):
    with pytest.raises(ValueError, match=rf"^{name} has shape \(.*\): give [^.]*\.(\n|$)"):
        estimator(np.ones(scores), np.ones(returns), None if fisher is None else np.ones(fisher))
