"""The rivals' settings: equal where the comparison asks for it, and each with its own use of pi_B."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import registry, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.rivals import IBRL, NEVER, RLPD, JumpStartConfig
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import controller
from srl_jax.types import ActState
from tests.agents.reference import ACTION, OBSERVATION, batch_of
from tests.agents.small_srl import KEY, SHARED, STATIC, STEP, convinced, high, run, student

RIVALS = {"rlpd": RLPD, "ibrl": IBRL, "jsrl": JumpStartConfig()}
SMALL = dataclasses.replace(IBRL, **SHARED, noise=(0.1,))
act = jax.jit(srl.act, static_argnames=STATIC)


@pytest.mark.parametrize("name", RIVALS)
def test_networks_updates_and_rates_are_srls(name):
    mine, srls = RIVALS[name], SRLConfig()
    assert registry.settings(name) == mine
    shared = (
        "hidden layer_norm batch critics critic_updates critic_lr actor_lr gamma tau freeze noise noise_correlation"
    )
    for field in shared.split():
        assert getattr(mine, field) == getattr(srls, field), field
    assert mine.guidance_weight == (0.0,) and mine.init == "random"
    assert registry.agent(mine).replays_healthy == (name == "rlpd") and registry.agent(mine).timed == (name == "jsrl")


def test_half_of_rlpds_batches_are_healthy_for_ever():
    hyper = from_config(RLPD)
    for step in (0.0, 5e4, 1e8):
        share = hyper.prior_fraction * jnp.maximum(1.0 - jnp.float32(step) / hyper.prior_decay, 0.0)
        assert float(share) == 0.5, "as `program.learn.mix_prior` reckons it"
    assert RLPD.prior_decay == (NEVER,) and not RLPD.select


@pytest.mark.parametrize(("slope", "who"), [(1.0, 1), (-1.0, 0)])
def test_ibrl_acts_and_bootstraps_by_whom_the_mean_critic_prefers(slope, who):
    state, idle, seen = convinced(slope), ActState(jnp.zeros(ACTION), controller.init()), jnp.ones(OBSERVATION)
    action, after = act(state, idle, seen, KEY, config=SMALL, hyper=from_config(SMALL), step=STEP, teachers=(high,))
    assert after.guidance.choice == who
    own = jnp.clip(student(state.actor, seen) + 0.1 * after.noise, -1, 1)
    np.testing.assert_allclose(action, high(seen) if who else own, atol=1e-6)
    batch = batch_of()
    chosen = np.full(len(batch.reward), 1.6) if who else student(state.target_actor, batch.next_observation).sum(1)
    target = batch.reward + 0.97 * batch.discount * slope * (4.0 + chosen)
    error = slope * (4.0 + batch.action.sum(1)) - target
    _, metrics = run(state, batch, SMALL, teachers=(high,))
    assert metrics["critic_loss"] == pytest.approx(np.mean(np.square(error)), rel=1e-4)
