"""Survivable robotic learning (Raza et al. 2021): DDPG whose critic is a posterior that weighs pi_B's advice.

Parts as in the paper: proposals and Thompson's sample with commitment (`act`), the posterior's likelihood
(`posterior.critic_loss`), the behaviour target (`next_action`) and guidance of the actor's gradient (`guidance`). The
start from pi_B and the healthy replay are the caller's: they change the initial actor and the batch, not the update.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp

from srl_jax.agents import ddpg, descent, ensemble, noise, posterior
from srl_jax.agents.ddpg import AgentState, student
from srl_jax.agents.ensemble import critic_fn
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics, Teacher
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import controller, dropout, thompson
from srl_jax.types import ActState, Params, Transition

init = ddpg.init
METRICS = (*ddpg.METRICS, "p_guid")


def proposals(actor: Params, observation: jax.Array, teachers: Sequence[Teacher], *, config: SRLConfig) -> jax.Array:
    """``[pi_theta(s), pi_B1(s), ...]``, noise-free: f32[N + 1, A]."""
    return jnp.stack([student(actor, observation, config=config), *(teacher(observation) for teacher in teachers)])


def act(
    state: AgentState,
    act_state: ActState,
    observation: jax.Array,
    key: jax.Array,
    *,
    config: SRLConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[jax.Array, ActState]:
    """Thompson's choice among the proposals, held to by the controller, plus exploration noise (Alg. 1).

    Arguments and results as `ddpg.act`; ``guidance.choice`` of the result is 0 for the student, 1.. for teachers.
    """
    mask_key, select_key, noise_key = jax.random.split(key, 3)
    actions = proposals(state.actor, observation, teachers, config=config)
    if config.noisy_proposals:
        noisy, act_state = noise.explore(actions[0], act_state, noise_key, hyper=hyper, step=step)
        actions = actions.at[0].set(noisy)
    guidance = act_state.guidance
    if config.select and len(actions) > 1:
        masks = posterior.sample(mask_key, config=config, hyper=hyper, proposals=len(actions))
        draws = dropout.q_draws(critic_fn(config), state.critic, observation, actions, masks)
        guidance = choose(guidance, draws, select_key, config=config, hyper=hyper)
    act_state = act_state._replace(guidance=guidance)
    if config.noisy_proposals:
        return actions[guidance.choice], act_state
    return noise.explore(actions[guidance.choice], act_state, noise_key, hyper=hyper, step=step)


def choose(guidance, draws: jax.Array, key: jax.Array, *, config: SRLConfig, hyper: Hyper):
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


def next_action(state: AgentState, batch: Transition, teachers: Sequence[Teacher], *, config: SRLConfig) -> jax.Array:
    """The TD target's action f32[B, A]: the target actor's, or the best proposal under the online mean critic."""
    if not (config.behaviour_target and teachers):
        return student(state.target_actor, batch.next_observation, config=config)

    def best(observation: jax.Array) -> jax.Array:
        actions = proposals(state.target_actor, observation, teachers, config=config)
        q = jax.vmap(lambda a: dropout.mean_q(critic_fn(config), state.critic, observation, a))(actions)
        return actions[jnp.argmax(q)]

    return jax.vmap(best)(batch.next_observation)


def guidance(
    critic: Params,
    batch: Transition,
    action: jax.Array,
    advice: jax.Array,
    key: jax.Array,
    *,
    config: SRLConfig,
    hyper: Hyper,
    step: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """Who guides at every state, and how surely: ``p_guid(s) = P[Q(s, pi_n*(s)) > Q(s, pi(s))]``.

    The guide n* is the teacher whom the posterior mean holds to be the best there, ``argmax_n mean_m Q_m(s, pi_n(s))``,
    so that a second teacher takes nothing from the first where it has nothing better to say. Samples are the same for
    all actions. `config.guidance_weighting` has two controls: the verdict of the mean critic on the best under it, and
    a function of time alone, which asks no critic and so follows the first teacher.

    Args:
        critic: ensemble parameters.
        batch: transitions, leading axis B.
        action: f32[B, A] the student's.
        advice: f32[B, N, A] the teachers'.
        key: random key.
        config: static settings.
        hyper: numeric settings.
        step: f32[] environment steps taken so far by the lane.

    Returns:
        p_guid f32[B] and the guide's index into N i32[B], without gradient.
    """
    if config.guidance_weighting == "annealed":
        weight = jnp.maximum(1.0 - step / hyper.guidance_decay, 0.0)
        return jnp.full(len(action), weight), jnp.zeros(len(action), jnp.int32)
    if config.guidance_weighting == "mean":
        mean = lambda a: jnp.mean(ensemble.q_values(critic, batch.observation, a, config=config), axis=0)  # noqa: E731
        advised = jax.vmap(mean, 1, 1)(advice)
        better = jnp.max(advised, axis=1) > mean(action)
        return jax.lax.stop_gradient((better.astype(action.dtype), jnp.argmax(advised, axis=1)))
    shape = (config.critics, config.guidance_draws // config.critics)
    masks = dropout.sample_masks(key, config.hidden, shape, hyper.dropout)

    def at_state(observation: jax.Array, own: jax.Array, others: jax.Array) -> tuple[jax.Array, jax.Array]:
        actions = jnp.concatenate([own[None], others])
        draws = dropout.q_draws(critic_fn(config), critic, observation, actions, masks)
        guide = jnp.argmax(jnp.mean(draws[:, 1:], axis=0))
        return thompson.probability_better(draws, guide + 1, 0, config.estimator), guide

    return jax.lax.stop_gradient(jax.vmap(at_state)(batch.observation, action, advice))


def update(
    state: AgentState,
    batch: Transition,
    key: jax.Array,
    *,
    config: SRLConfig,
    hyper: Hyper,
    step: jax.Array,
    teachers: Sequence[Teacher] = (),
) -> tuple[AgentState, Metrics]:
    """One update of posterior, actor and targets; arguments as `ddpg.update`.

    The actor descends ``-mean_k Q_k(s, pi(s)) + g p_guid(s) ||pi(s) - pi_n*(s)||^2`` (Sec. "Partially Guidance"), with
    the guide n* of `guidance` at every state: however many teachers there are, one pulls, with the full weight g.

    Returns:
        The new state and scalar metrics ``critic_loss``, ``q``, ``p_guid``.
    """
    critic_key, guidance_key = jax.random.split(key)

    def descend_critic(state: AgentState, part: Transition, key: jax.Array) -> tuple[AgentState, Metrics]:
        chosen = next_action(state, part, teachers, config=config)
        target = ensemble.td_target(state.target_critic, part, chosen, config=config, hyper=hyper)
        loss = partial(posterior.critic_loss, batch=part, target=target, key=key, step=step, config=config, hyper=hyper)
        return ddpg.critic_step(state, loss, config=config, hyper=hyper)

    state, critic_metrics = ddpg.learn_critic(state, batch, critic_key, descend_critic, config=config, hyper=hyper)
    seen = ddpg.last_part(batch, config)
    guided = bool(teachers) and any(weight > 0.0 for weight in config.guidance_weight)

    def actor_loss(params: Params) -> tuple[jax.Array, Metrics]:
        action = student(params, seen.observation, config=config)
        q = jnp.mean(ensemble.q_values(state.critic, seen.observation, action, config=config))
        if not guided:
            return -q, {"q": q, "p_guid": jnp.zeros(())}
        advice = jnp.stack([jax.vmap(teacher)(seen.observation) for teacher in teachers], axis=1)
        own = jax.lax.stop_gradient(action)
        p_guid, guide = guidance(state.critic, seen, own, advice, guidance_key, config=config, hyper=hyper, step=step)
        followed = jax.vmap(lambda of_state, index: of_state[index])(advice, guide)
        distance = jnp.sum(jnp.square(action - followed), axis=-1)
        pull = hyper.guidance_weight * jnp.mean(p_guid * distance)
        return pull - q, {"q": q, "p_guid": jnp.mean(p_guid)}

    state, actor_metrics = ddpg.actor_step(state, actor_loss, config=config, hyper=hyper, step=step)
    target_actor = descent.track(state.actor, state.target_actor, hyper=hyper)
    return state._replace(target_actor=target_actor), critic_metrics | actor_metrics


def agent(config: SRLConfig) -> Agent:
    """SRL as the program knows it: DDPG's record with its own way to act, to learn and to fill a mini-batch."""
    return dataclasses.replace(
        ddpg.agent(config),
        act=partial(act, config=config),
        update=partial(update, config=config),
        metrics=METRICS,
        replays_healthy=max(config.prior_fraction) > 0.0,
    )
