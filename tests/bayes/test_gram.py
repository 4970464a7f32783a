"""The Gram form of Bayesian quadrature, for networks: against the dense form, as a baseline, faults."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes import gram, quadrature

posterior = jax.jit(gram.posterior)


def data(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Scores f64[count, 5] and returns f64[count]."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(5, 5)) + 2 * np.eye(5)
    return rng.normal(size=(count, 5)) @ root.T, rng.normal(size=count)


def tree(U: np.ndarray) -> dict:
    return {"bias": jnp.asarray(U[:, 0]), "kernel": jnp.asarray(U[:, 1:].reshape(len(U), 2, -1))}


def flat(parts: dict) -> np.ndarray:
    return np.concatenate([np.ravel(parts["bias"]), np.ravel(parts["kernel"])])


@pytest.mark.parametrize(("count", "total"), [(8, 8), (8, 30)])
def test_equals_the_dense_form(count, total, x64):
    U, R = data(total)
    scores, R = tree(U), R[:count]
    S = gram.matrix(scores)
    np.testing.assert_allclose(S, U @ U.T, rtol=1e-10)
    ridge = 0.05
    fisher = (U.T @ U + ridge * np.trace(S) / total * np.eye(5)) / total
    dense = jax.jit(quadrature.model2)(U[:count], R, fisher, noise=0.4, scale=2.0)
    found = posterior(S, R, noise=0.4, scale=2.0, ridge=ridge)
    assert found.ok
    np.testing.assert_allclose(flat(gram.combine(found.weights, scores)), dense.mean, rtol=1e-7)
    np.testing.assert_allclose(flat(gram.variance(found, scores)), np.diag(dense.covariance), rtol=1e-7)


@pytest.mark.parametrize("count", [4, 12], ids=["fewer scores than parameters", "more"])
def test_with_the_policys_own_information_it_equals_the_dense_form_in_the_span(count, x64):
    U, R = data(count)
    U = 3.0 * U + 2.0  # scores of another policy's actions: neither of mean zero nor of the policy's second moment
    root = data(20)[0] / np.sqrt(20)
    fisher = root.T @ root
    span = np.linalg.svd(U, full_matrices=False)[2]
    within = span @ fisher @ span.T
    within += 0.05 * np.trace(within) / len(within) * np.eye(len(within))
    dense = jax.jit(quadrature.model2)(U @ span.T, R, within, noise=0.4, scale=2.0)
    scores = tree(U)
    found = posterior(gram.matrix(scores), R, noise=0.4, scale=2.0, ridge=0.05, information=U @ root.T)
    assert found.ok
    np.testing.assert_allclose(flat(gram.combine(found.weights, scores)), dense.mean @ span, rtol=1e-6)


def test_a_constant_state_kernel_is_a_baseline(x64):
    U, _ = data(40)
    weights = np.arange(5.0)
    S, fisher = gram.matrix(tree(U)), U.T @ U / 40
    found = posterior(S, 50.0 + U @ weights, 1e4 * jnp.ones((40, 40)), noise=1e-6, ridge=1e-9)
    np.testing.assert_allclose(flat(gram.combine(found.weights, tree(U))), fisher @ weights, rtol=1e-4)
    without = posterior(S, 50.0 + U @ weights, noise=1e-6, ridge=1e-9)
    assert np.abs(flat(gram.combine(without.weights, tree(U))) - fisher @ weights).max() > 1.0


def test_faults_are_flagged_and_wrong_shapes_refused():
    S, R = jnp.eye(4), jnp.ones(4)
    run = jax.vmap(posterior)
    found = run(jnp.stack([S, S, 0 * S, S]), jnp.stack([R, R.at[1].set(jnp.inf), R, 2 * R]))
    assert found.ok.tolist() == [True, False, False, True]
    assert np.all(found.weights[1:3] == 0) and np.all(np.isfinite(found.factor))
    np.testing.assert_allclose(found.weights[3], 2 * found.weights[0], rtol=1e-6)
    for name, arguments in {
        "returns": (S, jnp.ones(0)),
        "gram": (S, jnp.ones(5)),
        "state_kernel": (S, R, jnp.eye(3)),
    }.items():
        with pytest.raises(ValueError, match=rf"^{name} has shape"):
            posterior(*arguments)
