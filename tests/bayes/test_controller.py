"""Commitment: when a switch is taken, refused, counted and forgotten."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes import controller
from srl_jax.bayes.controller import Commitment
from srl_jax.types import GuidanceState

KEY = jax.random.key(0)
HYPER = Commitment(jnp.float32(0.6), jnp.float32(0.99))
STATIC = ("estimator", "switch_rule", "fallback")
select = jax.jit(controller.select, static_argnames=STATIC)


def state(choice: int, refused: int = 0) -> GuidanceState:
    return GuidanceState(jnp.int32(choice), jnp.int32(refused))


def posterior(wins: int, of: int = 10) -> jax.Array:
    """Two policies, of which the second is better in `wins` of the draws."""
    second = np.where(np.arange(of) < wins, 1.0, -1.0)
    return jnp.asarray(np.stack([np.zeros(of), second], axis=1), jnp.float32)


def key_proposing(draws: jax.Array, wanted: int) -> jax.Array:
    """A key under which Thompson's sample prefers `wanted`."""
    for seed in range(200):
        key = jax.random.key(seed)
        followed, acting = select(state(wanted), draws, key, hyper=Commitment(jnp.float32(2.0), jnp.float32(1.0)))
        if followed.refused == 0 and acting == wanted:
            return key
    raise AssertionError("no key found")


def test_an_episode_starts_with_the_student_and_no_refusal():
    start = controller.init()
    assert (start.choice, start.refused) == (0, 0)
    assert start.choice.dtype == start.refused.dtype == jnp.int32


def test_the_policy_in_command_stays_when_it_is_proposed():
    draws = posterior(wins=10)
    after, acting = select(state(1, refused=4), draws, KEY, hyper=HYPER)
    assert (acting, after.choice, after.refused) == (1, 1, 4), "keeping is no switch: the count stays"


@pytest.mark.parametrize(("wins", "switches"), [(5, False), (6, False), (7, True), (10, True)])
def test_switch_needs_more_than_beta(wins, switches):
    draws = posterior(wins)
    after, acting = select(state(0, 0), draws, key_proposing(draws, 1), hyper=HYPER)
    assert acting == after.choice == int(switches)
    assert after.refused == (0 if switches else 1)


@pytest.mark.parametrize("refused", [0, 1, 7, 40, 200])
def test_threshold_decays_with_every_refusal(refused):
    draws, key = posterior(4), key_proposing(posterior(4), 1)
    hyper = Commitment(jnp.float32(0.6), jnp.float32(0.98))
    after, _ = select(state(0, refused), draws, key, hyper=hyper)
    assert after.choice == int(0.6 * 0.98**refused < 0.4)
    assert after.refused == (0 if after.choice else refused + 1)


def test_refusals_add_up_until_the_switch_and_then_reset():
    draws, key, now = posterior(4), key_proposing(posterior(4), 1), controller.init()
    counts = []
    while now.choice == 0 and len(counts) < 100:
        now, acting = select(now, draws, key, hyper=Commitment(jnp.float32(0.6), jnp.float32(0.98)))
        counts.append(int(now.refused))
        assert acting == now.choice
    needed = int(np.ceil(np.log(0.4 / 0.6) / np.log(0.98)))
    assert counts == [*range(1, needed + 1), 0]


@pytest.mark.parametrize(("fallback", "acts"), [("previous", 2), ("actor", 0)])
def test_who_acts_after_a_refusal(fallback, acts):
    draws = jnp.tile(jnp.array([0.0, 1.0, 0.5]), (8, 1))  # the second policy is proposed, surely better
    hyper = Commitment(jnp.float32(1.0), jnp.float32(1.0))  # never sure enough
    after, acting = select(state(2, 3), draws, KEY, hyper=hyper, fallback=fallback)
    assert (acting, after.choice, after.refused) == (acts, acts, 4)


@pytest.mark.parametrize("wins", range(1, 11))
def test_released_acteach_rule_switches_when_the_current_policy_is_better(wins):
    draws = posterior(wins)
    key = key_proposing(draws, 1)
    corrected, _ = select(state(0), draws, key, hyper=HYPER)
    released, _ = select(state(0), draws, key, hyper=HYPER, switch_rule="acteach_release")
    assert corrected.choice == int(wins / 10 > 0.6 + 1e-6)
    assert released.choice == int(1 - wins / 10 > 0.6 + 1e-6)


def test_estimators_may_disagree_and_are_both_used():
    draws = posterior(9).at[9, 1].set(-100.0)  # nine small wins, one great loss
    key = key_proposing(draws, 1)
    assert select(state(0), draws, key, hyper=HYPER, estimator="paired")[1] == 1
    assert select(state(0), draws, key, hyper=HYPER, estimator="gaussian")[1] == 0


def test_no_commitment_without_threshold():
    draws = posterior(3)
    _, acting = select(state(0), draws, key_proposing(draws, 1), hyper=Commitment(jnp.float32(0.0), HYPER.psi))
    assert acting == 1


@pytest.mark.parametrize("estimator", ["paired", "gaussian"])
def test_equal_policies_never_make_nan_or_a_switch(estimator):
    draws = jnp.zeros((6, 3))
    after, acting = select(state(0), draws, KEY, hyper=HYPER, estimator=estimator)
    assert (acting, after.choice, after.refused) == (0, 0, 0)
    after, acting = select(state(2), draws, KEY, hyper=HYPER, estimator=estimator)
    assert (acting, after.refused) == (2, 1), "probability 1/2 is not above beta"


@pytest.mark.parametrize("static", [{}, {"switch_rule": "acteach_release"}, {"fallback": "actor"}])
@pytest.mark.parametrize("estimator", ["paired", "gaussian"])
def test_vmap_equals_one_by_one(static, estimator):
    rng = np.random.default_rng(0)
    lanes = 16
    states = GuidanceState(jnp.asarray(rng.integers(3, size=lanes), jnp.int32), jnp.arange(lanes, dtype=jnp.int32))
    draws = jnp.asarray(rng.normal(size=(lanes, 12, 3)), jnp.float32)
    keys = jax.random.split(KEY, lanes)
    hyper = Commitment(jnp.linspace(0.1, 0.9, lanes), jnp.full(lanes, 0.99))
    one = lambda s, d, k, h: controller.select(s, d, k, hyper=h, estimator=estimator, **static)  # noqa: E731
    wide, acting = jax.jit(jax.vmap(one))(states, draws, keys, hyper)
    row = partial(jax.tree.map)
    for lane in range(lanes):
        pick = lambda x, i=lane: x[i]  # noqa: E731
        alone, who = select(
            row(pick, states), draws[lane], keys[lane], hyper=row(pick, hyper), estimator=estimator, **static
        )
        assert (alone.choice, alone.refused, who) == (wide.choice[lane], wide.refused[lane], acting[lane])
