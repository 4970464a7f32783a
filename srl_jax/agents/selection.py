"""Who acts: the proposals of the student and its teachers, and the choice between them."""

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp

from srl_jax.agents import posterior
from srl_jax.agents.ddpg import student
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Teacher
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import controller, thompson
from srl_jax.types import GuidanceState, Params


def proposals(actor: Params, observation: jax.Array, teachers: Sequence[Teacher], *, config: SRLConfig) -> jax.Array:
    """``[pi_theta(s), pi_B1(s), ...]``, noise-free: f32[N + 1, A]."""
    return jnp.stack([student(actor, observation, config=config), *(teacher(observation) for teacher in teachers)])


def select(
    guidance: GuidanceState,
    critic: Params,
    observation: jax.Array,
    actions: jax.Array,
    keys: Sequence[jax.Array],
    *,
    config: SRLConfig,
    hyper: Hyper,
) -> GuidanceState:
    """Who is to act of those that propose f32[N, A]: Thompson's choice, held to by the controller, or the greedy one.

    The greedy choice is ``argmax_i mean_k Q_k(s, a_i)`` (imitation-bootstrapped RL: Hu et al. 2024). Two keys.
    """
    if config.selection == "greedy":
        best = jnp.argmax(posterior.means(critic, observation, actions, config=config))
        return guidance._replace(choice=best.astype(jnp.int32))
    mask_key, draw_key = keys
    masks = posterior.sample(mask_key, config=config, hyper=hyper, proposals=len(actions))
    draws = posterior.draws(critic, observation, actions, masks, config=config)
    return choose(guidance, draws, draw_key, config=config, hyper=hyper)


def keep(old: GuidanceState, new: GuidanceState, age: jax.Array | None, segment: int) -> GuidanceState:
    """The new choice at the first of every `segment` control steps of an episode, the old one at the others.

    Raises:
        ValueError: the age of the episode i32[] is not known.
    """
    if segment == 0:
        return new
    if age is None:
        raise ValueError(f"segment is {segment}: it needs act_state.age, the control steps since the episode began.")
    return jax.tree.map(partial(jnp.where, age % segment == 0), new, old)


def choose(
    guidance: GuidanceState, draws: jax.Array, key: jax.Array, *, config: SRLConfig, hyper: Hyper
) -> GuidanceState:
    """The controller's new state from posterior draws f32[M, N]; without commitment, Thompson's choice alone."""
    if not config.commit:
        return guidance._replace(choice=thompson.choose(draws, key))
    guidance, _ = controller.select(
        guidance,
        draws,
        key,
        hyper=controller.Commitment(hyper.beta, hyper.psi),
        estimator=config.estimator,
        switch_rule=config.switch_rule,
        fallback=config.fallback,
    )
    return guidance
