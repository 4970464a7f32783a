"""The likelihood of SRL's critics against NumPy, each member's data, and the decay that makes dropout variational."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ensemble, posterior
from srl_jax.agents.hyper import from_config
from srl_jax.agents.rivals import ACTEACH
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import dropout
from tests.agents.reference import ACTION, BATCH, OBSERVATION, assert_same_movement, batch_of, loop_draws

FULL = SRLConfig(hidden=(8, 8), layer_norm=False, critics=2, batch=BATCH, dropout=(0.3,), draws=8)
KEY, STEP = jax.random.key(0), jnp.float32(1e4)
PARAMS = ensemble.init(KEY, OBSERVATION, ACTION, config=FULL)
critic_loss = jax.jit(posterior.critic_loss, static_argnames="config")
critic_of = jax.jit(ensemble.critic_fn(FULL))
member = lambda tree, k: jax.tree.map(lambda leaf: leaf[k : k + 1], tree)  # noqa: E731
TARGET = jnp.array([batch_of(1).reward, batch_of(2).reward])  # f32[K, B]


def change(config: SRLConfig = FULL, **fields) -> SRLConfig:
    return dataclasses.replace(config, **fields)


def loss_of(config: SRLConfig, params=PARAMS, target=TARGET, batch=None, step=STEP, key=KEY):
    batch = batch_of() if batch is None else batch
    return critic_loss(params, batch, target, key, config=config, hyper=from_config(config), step=step)


def squares(kernels_only: bool = False) -> float:
    leaves = jax.tree.leaves_with_path(PARAMS)
    return sum(float(np.sum(np.square(x))) for path, x in leaves if path[-1].key == "kernel" or not kernels_only)


# The likelihoods


def test_alpha_divergence_equals_numpy_each_member_over_its_own_draws():
    config, batch = change(critic_loss="alpha", weight_decay=(0.1,)), batch_of()
    loss, metrics = loss_of(config)
    masks = posterior.sample(KEY, config=config, hyper=from_config(config))
    alpha, tau, value = 0.5, 10.0, 0.0
    for b in range(BATCH):
        q = loop_draws(critic_of, PARAMS, batch.observation[b], [batch.action[b]], masks).reshape(4, 2)
        for k in range(2):
            error = TARGET[k, b] - q[:, k]
            value += -np.log(np.sum(np.exp(-0.5 * alpha * tau * error**2))) / alpha / BATCH
    assert metrics["critic_loss"] == pytest.approx(value / 2, rel=1e-4)
    assert loss == pytest.approx(value + 0.1 * squares(), rel=1e-4)


def test_a_member_that_fits_badly_learns_as_if_it_were_alone():
    both, one = change(critic_loss="alpha"), change(critic_loss="alpha", critics=1, draws=4)
    masks = posterior.sample(KEY, config=both, hyper=from_config(both))
    far = TARGET.at[1].add(3.0)
    slope = jax.grad(lambda p: loss_of(both, p, far)[0])(PARAMS)

    def alone(params) -> jax.Array:
        q = jax.vmap(dropout.q_draws, (None, None, 0, 0, None), 1)(
            ensemble.critic_fn(one), params, batch_of().observation, batch_of().action[:, None], member(masks, 1)
        )[..., 0]
        return -2.0 * jnp.mean(jax.nn.logsumexp(-2.5 * jnp.square(far[1][None] - q), axis=0))

    expected = jax.grad(alone)(member(PARAMS, 1))
    assert_same_movement(jax.tree.map(jnp.zeros_like, expected), member(slope, 1), expected, 1e-4)


def test_squared_error_has_a_mask_per_sample_and_member():
    config, batch = change(dropout_update=True), batch_of()
    loss, metrics = loss_of(config)
    masks = dropout.sample_masks(KEY, config.hidden, (2, BATCH), jnp.float32(0.3))
    value = 0.0
    for b in range(BATCH):
        own = tuple(mask[:, b : b + 1] for mask in masks)
        q = loop_draws(critic_of, PARAMS, batch.observation[b], [batch.action[b]], own)[:, 0]
        value += float(np.sum((q - TARGET[:, b]) ** 2)) / BATCH
    assert loss == pytest.approx(value, rel=1e-5)
    assert metrics["critic_loss"] == pytest.approx(value / 2, rel=1e-5)


def test_acteach_is_one_network_of_fifty_draws_as_published():
    assert (ACTEACH.critics, ACTEACH.critic_updates, ACTEACH.draws) == (1, 1, 50)
    assert (ACTEACH.alpha, ACTEACH.precision, ACTEACH.critic_loss) == ((0.5,), (10.0,), "alpha")
    assert 0.1 <= ACTEACH.dropout[0] <= 0.2 and ACTEACH.noisy_proposals and not ACTEACH.shared_masks


# Each member's data


def test_a_transition_is_in_a_members_data_for_good():
    lot = jnp.asarray(np.random.default_rng(0).integers(0, 2**24, 4_000), jnp.float32)
    data = posterior.data_of_members(lot, jnp.float32(0.6), 3)
    assert data.shape == (3, 4_000) and set(np.unique(data)) == {0.0, 1.0}
    order = np.random.default_rng(1).permutation(4_000)
    np.testing.assert_array_equal(posterior.data_of_members(lot[order], jnp.float32(0.6), 3), data[:, order])
    np.testing.assert_allclose(data.mean(1), 0.6, atol=4 * np.sqrt(0.24 / 4_000))
    assert np.abs(np.corrcoef(data) - np.eye(3)).max() < 4.5 / np.sqrt(4_000), "members have samples of their own"
    more = posterior.data_of_members(lot, jnp.float32(0.8), 3)
    assert np.all(more >= data), "a greater share adds transitions and takes none away"


@pytest.mark.parametrize("kind", ["td", "alpha"])
def test_the_loss_counts_each_members_data_whatever_the_key(kind):
    config = change(bootstrap=(0.5,), critic_loss=kind)
    data = np.asarray(posterior.data_of_members(jnp.asarray(batch_of().lot), jnp.float32(0.5), 2))
    assert 0 < data.sum() < data.size and np.any(data[0] != data[1])
    hyper = from_config(config)
    loss = {"td": posterior._squared_error, "alpha": posterior._divergence}[kind]
    each = np.asarray(loss(PARAMS, batch_of(), TARGET, KEY, config=config, hyper=hyper))
    assert loss_of(config)[0] == pytest.approx(float((each * data).mean(1).sum()), rel=1e-4)
    if kind == "td":  # which draws nothing else
        assert loss_of(config, key=jax.random.key(9))[0] == loss_of(config)[0]
    assert loss_of(change(config, bootstrap=(0.0,)))[0] == 0.0
    everything = loss_of(change(config, bootstrap=(1.0,)))[0]
    assert everything == pytest.approx(float(each.mean(1).sum()), rel=1e-4)


# Weight decay


@pytest.mark.parametrize(("kind", "unit"), [("td", 1.0 / 10.0), ("alpha", 0.5)])
def test_variational_decay_is_that_of_gal_and_ghahramani(kind, unit):
    config = change(critic_loss=kind, length_scale=(2.0,), dropout=(0.2,))
    for step, seen in ((0.0, 1.0), (500.0, 500.0)):
        loss, metrics = loss_of(config, step=jnp.float32(step))
        decay = 0.8 * 2.0**2 * unit / seen * squares(kernels_only=True)
        assert loss - 2 * metrics["critic_loss"] == pytest.approx(decay, rel=1e-3)
    plain = change(config, length_scale=(0.0,), weight_decay=(0.1,))
    loss, metrics = loss_of(plain)
    assert loss - 2 * metrics["critic_loss"] == pytest.approx(0.1 * squares(), rel=1e-3)


def test_variational_decay_is_in_the_units_of_each_loss():
    """The alpha-divergence of one draw is tau / 2 squared errors, and its decay is as many times as large."""
    hyper = from_config(FULL, length_scale=1.0)
    settings = {kind: change(critic_loss=kind, length_scale=(1.0,)) for kind in ("td", "alpha")}
    decay = lambda kind: posterior.weight_decay(PARAMS, config=settings[kind], hyper=hyper, step=STEP)  # noqa: E731
    assert decay("alpha") == pytest.approx(float(decay("td")) * 10.0 / 2.0, rel=1e-5)
    one = change(critic_loss="alpha", draws=2, dropout=(0.0,))
    divergence = loss_of(one)[0] - loss_of(one, target=posterior_mean())[0]
    td = loss_of(change(dropout=(0.0,)))[0] - loss_of(change(dropout=(0.0,)), target=posterior_mean())[0]
    assert divergence == pytest.approx(5.0 * float(td), rel=1e-4)


def posterior_mean() -> jax.Array:
    """The members' own values, at which both losses are least."""
    return ensemble.q_values(PARAMS, batch_of().observation, batch_of().action, config=FULL)
