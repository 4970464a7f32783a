"""Gaussian-process temporal differences: the printed equations with H formed, known values, tinygp, faults."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tinygp

from srl_jax.bayes import gptd, gram

GAMMA, SIZE = 0.9, 3
KERNEL = gptd.rbf(0.7, 1.5)

fit = jax.jit(gptd.fit, static_argnums=1)
q = jax.jit(gptd.q, static_argnums=1)
gradient = jax.jit(gptd.gradient)


def episodes(seed: int = 0):
    """Two episodes over ten points: points 0-4 are cut short at point 4, points 5-9 end in a terminal state.

    Returns features, scores and H f[9, 10] over the points, and the transitions and links that say the same.
    """
    rng = np.random.default_rng(seed)
    features, scores, rewards = rng.normal(size=(10, 2)), rng.normal(size=(10, SIZE)), rng.normal(size=9)
    start = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9])
    end = (start + 1) % 10  # what follows the last point is of no account
    discounts = np.where(start == 9, 0.0, GAMMA)
    H = np.zeros((9, 10))
    for row in range(9):
        H[row, start[row]] = 1.0
        if start[row] != 9:
            H[row, start[row] + 1] = -GAMMA
    data = gptd.Transitions(features[start], scores[start], rewards, discounts, features[end], scores[end])
    return features, scores, H, data, (start != 3) & (start != 9)


@pytest.mark.parametrize("correlated", [False, True], ids=["independent", "correlated"])
def test_posteriors_equal_the_printed_equations(correlated, x64):
    features, scores, H, data, linked = episodes()
    G, noise, scale = np.diag([1.0, 2.0, 3.0]) + 0.3, 0.2, 1.7
    inverse = np.linalg.inv(G)
    states = lambda x, y: 1.5 * np.exp(-0.5 * np.sum((x[:, None] - y[None]) ** 2, -1) / 0.7**2)  # noqa: E731
    K = states(features, features) + scale * scores @ inverse @ scores.T
    sigma = noise * (H @ H.T if correlated else np.eye(9))
    middle = np.linalg.inv(H @ K @ H.T + sigma)
    alpha, C, U = H.T @ middle @ data.rewards, H.T @ middle @ H, scale * scores.T

    critic = fit(data, KERNEL, G, noise=noise, scale=scale, linked=linked if correlated else None)
    found = gradient(critic)
    assert critic.ok and found.ok
    np.testing.assert_allclose(found.mean, U @ alpha, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, scale * G - U @ C @ U.T, rtol=1e-8)

    at, along = np.random.default_rng(1).normal(size=(4, 2)), np.random.default_rng(2).normal(size=(4, SIZE))
    cross = states(at, features) + scale * along @ inverse @ scores.T
    prior = 1.5 + scale * np.diag(along @ inverse @ along.T)
    mean, variance = q(critic, KERNEL, at, along)
    np.testing.assert_allclose(mean, cross @ alpha, rtol=1e-8)
    np.testing.assert_allclose(variance, prior - np.diag(cross @ C @ cross.T), rtol=1e-8)


@pytest.mark.parametrize("correlated", [False, True], ids=["independent", "correlated"])
def test_a_deterministic_chain_gives_its_returns_as_noise_vanishes(correlated, x64):
    rewards = np.array([1.0, -2.0, 0.5, 3.0, 10.0])
    places, zeros = np.arange(6.0)[:, None], np.zeros((5, 1))
    data = gptd.Transitions(places[:5], zeros, rewards, np.array([GAMMA] * 4 + [0.0]), places[1:], zeros)
    linked = np.array([True] * 4 + [False]) if correlated else None
    returns = np.array([sum(GAMMA**k * r for k, r in enumerate(rewards[start:])) for start in range(5)])
    errors = []
    for noise in (1e-1, 1e-3, 1e-9):
        critic = fit(data, gptd.rbf(1.0, 100.0), np.eye(1), noise=noise, linked=linked)
        errors.append(np.abs(q(critic, gptd.rbf(1.0, 100.0), places[:5], zeros)[0] - returns).max())
    assert errors[0] > errors[1] > errors[2] and errors[2] < 1e-5


def test_termination_cuts_the_value_and_truncation_does_not(x64):
    """Point 0 earns nothing and leads to point 1, which is known to be worth 5; the two are uncorrelated."""
    places, zeros = np.array([[0.0], [9.0]]), np.zeros((2, 1))
    value = {}
    for name, discount in (("terminated", 0.0), ("truncated", GAMMA)):
        ends = np.array([discount, 0.0])
        data = gptd.Transitions(places, zeros, np.array([0.0, 5.0]), ends, places[::-1], zeros)
        critic = fit(data, gptd.rbf(1.0, 10.0), np.eye(1), noise=1e-8)
        value[name] = q(critic, gptd.rbf(1.0, 10.0), places, zeros)[0]
    np.testing.assert_allclose(value["terminated"], [0.0, 5.0], atol=1e-5)
    np.testing.assert_allclose(value["truncated"], [GAMMA * 5.0, 5.0], atol=1e-5)


def test_the_order_of_a_replay_does_not_matter(x64):
    *_, data, _ = episodes()
    order = np.random.default_rng(0).permutation(9)
    shuffled = gptd.Transitions(*(field[order] for field in data))
    there, here = (gradient(fit(batch, KERNEL, np.eye(SIZE))) for batch in (data, shuffled))
    np.testing.assert_allclose(there.mean, here.mean, rtol=1e-9)
    np.testing.assert_allclose(there.covariance, here.covariance, rtol=1e-9)


def test_posterior_of_q_equals_tinygp(x64):
    """The library's own conditioning, told only the covariance of one pair of transitions with another."""
    features, scores, _, data, _ = episodes()

    def pair(one, other):
        def k(s, u, t, v):
            return 1.5 * jnp.exp(-0.5 * jnp.sum((s - t) ** 2) / 0.7**2) + u @ v

        (s, u, d, s_, u_), (t, v, e, t_, v_) = one, other
        return k(s, u, t, v) - e * k(s, u, t_, v_) - d * k(s_, u_, t, v) + d * e * k(s_, u_, t_, v_)

    rows = (data.features, data.scores, data.discounts, data.next_features, data.next_scores)
    points = (features, scores, np.zeros(10), features, scores)

    @jax.jit
    def condition(rows, points):
        kernel = tinygp.kernels.Custom(pair)
        process = tinygp.GaussianProcess(kernel, rows, diag=0.2, mean_value=jnp.zeros(9))
        posterior = process.condition(data.rewards, points, include_mean=False).gp
        return posterior.loc, posterior.variance

    exact_mean, exact_variance = condition(rows, points)
    mean, variance = q(fit(data, KERNEL, np.eye(SIZE), noise=0.2), KERNEL, features, scores)
    np.testing.assert_allclose(mean, exact_mean, rtol=1e-6)
    np.testing.assert_allclose(variance, exact_variance, rtol=1e-6)


def test_gradient_covariance_is_symmetric_and_shrinks_with_data(x64):
    *_, data, _ = episodes()
    before = np.eye(SIZE)
    for count in (2, 5, 9):
        part = gptd.Transitions(*(field[:count] for field in data))
        after = np.asarray(gradient(fit(part, KERNEL, np.eye(SIZE), noise=0.1)).covariance)
        np.testing.assert_allclose(after, after.T, atol=1e-12)
        assert np.linalg.eigvalsh(after).min() > 0
        assert np.linalg.eigvalsh(before - after).min() > -1e-9
        before = after


def test_the_gram_form_with_a_state_kernel_is_this_actor_for_networks(x64):
    *_, data, _ = episodes()
    data = data._replace(next_scores=0 * data.next_scores)
    S = gram.matrix(jnp.asarray(data.scores))
    fisher = (data.scores.T @ data.scores + 1e-3 * np.trace(S) / 9 * np.eye(SIZE)) / 9
    dense = gradient(fit(data, KERNEL, fisher, noise=0.2, scale=2.0))
    states = gptd.state_kernel(KERNEL, data.features, data.next_features, data.discounts)
    found = gram.posterior(S, data.rewards, states, noise=0.2, scale=2.0)
    np.testing.assert_allclose(gram.combine(found.weights, data.scores), dense.mean, rtol=1e-7)
    np.testing.assert_allclose(gram.variance(found, data.scores), np.diag(dense.covariance), rtol=1e-7)


def test_a_lane_sees_no_other_lane_and_faults_are_flagged():
    batch = gptd.Transitions(*(jnp.stack([jnp.asarray(field, jnp.float32)] * 4) for field in episodes()[3]))
    fisher = jnp.stack([jnp.eye(SIZE), jnp.eye(SIZE), jnp.diag(jnp.array([1.0, 0.0, 1.0])), jnp.eye(SIZE)])
    batch = batch._replace(rewards=batch.rewards.at[1, 2].set(jnp.inf).at[3].multiply(2.0))
    critics = jax.vmap(lambda data, g: fit(data, KERNEL, g, noise=0.1))(batch, fisher)
    found = jax.vmap(gradient)(critics)
    assert found.ok.tolist() == critics.ok.tolist() == [True, False, False, True]
    assert np.all(found.mean[1:3] == 0) and np.all(np.asarray(found.covariance[1:3]) == np.eye(SIZE))
    np.testing.assert_allclose(found.mean[3], 2 * found.mean[0], rtol=1e-4)
    mean, variance = jax.vmap(lambda c, d: q(c, KERNEL, d.features, d.scores))(critics, batch)
    assert np.all(np.isfinite(mean[::3])) and np.all(variance[::3] >= 0)
    assert not fit(episodes()[3], KERNEL, noise=-1.0).ok


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("rewards", (0,)),
        ("rewards", (9, 1)),
        ("features", (8, 2)),
        ("scores", (9,)),
        ("discounts", (9, 1)),
        ("next_features", (9, 3)),
        ("next_scores", (8, SIZE)),
        ("fisher", (2, 2)),
        ("linked", (8,)),
    ],
)
def test_wrong_shapes_are_refused_by_name(name, shape):
    *_, data, linked = episodes()
    wrong = np.ones(shape)
    arguments = {"fisher": np.eye(SIZE), "linked": linked}
    if name in arguments:
        arguments[name] = wrong
    else:
        data = data._replace(**{name: wrong})
    with pytest.raises(ValueError, match=rf"^{name} has shape \(.*\): give "):
        fit(data, KERNEL, **arguments)


def both(data: gptd.Transitions) -> gptd.Gradient:
    return gptd.gradient(gptd.fit(data, KERNEL, noise=10.0))  # well above the jitter of f32


def drawn(count: int) -> gptd.Transitions:
    rng = np.random.default_rng(0)
    features, scores = rng.normal(size=(count + 1, 10)), rng.normal(size=(count + 1, 50))
    rewards = scores[:-1] @ np.linspace(-1, 1, 50)
    return gptd.Transitions(features[:-1], scores[:-1], rewards, np.full(count, GAMMA), features[1:], scores[1:])


def test_transitions_cost_one_factorisation_of_their_number():
    program = str(jax.make_jaxpr(both)(drawn(73)))
    assert len(re.findall(r"f32\[73,73\] = cholesky", program)) == 1
    sizes = [np.prod([int(side) for side in shape.split(",")]) for shape in re.findall(r"f32\[([0-9,]+)\]", program)]
    assert max(sizes) == 73 * 73, "H, which has a point for every transition's end too, is never formed"


def test_a_thousand_transitions_in_single_precision_agree_with_double():
    data = drawn(1000)
    with jax.enable_x64(True):
        exact = jax.device_get(jax.jit(both)(data))
    found = jax.jit(both)(jax.tree.map(jnp.float32, data))
    assert found.ok and found.mean.dtype == jnp.float32 and exact.mean.dtype == np.float64
    np.testing.assert_allclose(found.mean, exact.mean, atol=2e-3 * np.abs(exact.mean).max())
