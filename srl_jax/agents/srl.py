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

from srl_jax.agents import ddpg, descent, ensemble, following, noise, posterior
from srl_jax.agents.ddpg import AgentState, student
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics, Teacher
from srl_jax.agents.selection import keep, proposals, select
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import dropout, thompson
from srl_jax.types import ActState, Params, Transition

METRICS = (*ddpg.METRICS, "p_guid")


def init(
    key: jax.Array,
    observation_size: int,
    action_size: int,
    *,
    config: SRLConfig,
    teachers: Sequence[Teacher] = (),
) -> AgentState:
    """Fresh networks, as `ddpg.init`; with `config.values` of policies the critics have a head for each of them."""
    heads = following.heads(config, teachers)
    return ddpg.init(key, observation_size, action_size, config=config, heads=heads)


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
    """The choice among the proposals, plus exploration noise (Alg. 1).

    Arguments and results as `ddpg.act`; ``guidance.choice`` of the result is 0 for the student, 1.. for teachers. Where
    a choice is kept for a segment, ``act_state.age`` is needed.
    """
    *select_keys, noise_key = jax.random.split(key, 3)
    actions = proposals(state.actor, observation, teachers, config=config)
    if config.noisy_proposals:
        noisy, act_state = noise.explore(actions[0], act_state, noise_key, hyper=hyper, step=step)
        actions = actions.at[0].set(noisy)
    guidance = act_state.guidance
    if config.select and len(actions) > 1:
        chosen = select(guidance, state.critic, observation, actions, select_keys, config=config, hyper=hyper)
        guidance = keep(guidance, chosen, act_state.age, config.segment)
    act_state = act_state._replace(guidance=guidance)
    if config.noisy_proposals:
        return actions[guidance.choice], act_state
    return noise.explore(actions[guidance.choice], act_state, noise_key, hyper=hyper, step=step)


def next_action(state: AgentState, batch: Transition, teachers: Sequence[Teacher], *, config: SRLConfig) -> jax.Array:
    """The TD target's action f32[B, A]: the target actor's, or the best proposal under the online mean critic."""
    if not (config.behaviour_target and teachers):
        return student(state.target_actor, batch.next_observation, config=config)

    def best(observation: jax.Array) -> jax.Array:
        actions = proposals(state.target_actor, observation, teachers, config=config)
        return actions[jnp.argmax(posterior.means(state.critic, observation, actions, config=config))]

    return jax.vmap(best)(batch.next_observation)


def td_target(
    state: AgentState, batch: Transition, teachers: Sequence[Teacher], *, config: SRLConfig, hyper: Hyper
) -> jax.Array:
    """What the critics learn to predict: f32[K, B], or of all policies f32[K, B, N + 1]."""
    if config.values == "policy":
        propose = lambda o: proposals(state.target_actor, o, teachers, config=config)  # noqa: E731
        actions = jax.vmap(propose)(batch.next_observation)
        return following.td_target(state.target_critic, batch, actions, config=config, hyper=hyper)
    chosen = next_action(state, batch, teachers, config=config)
    return ensemble.td_target(state.target_critic, batch, chosen, config=config, hyper=hyper)


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
    """Who guides at every state, and how surely: ``p_guid(s) = P[Q(s, pi_n*(s)) > Q(s, pi(s))]``, or of V_n* and V_0.

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
        own, advised = _means(critic, batch.observation, action, advice, config=config)
        better = jnp.max(advised, axis=1) > own
        return jax.lax.stop_gradient((better.astype(action.dtype), jnp.argmax(advised, axis=1)))
    shape = (config.critics, config.guidance_draws // config.critics)
    masks = dropout.sample_masks(key, config.hidden, shape, hyper.dropout)

    def at_state(observation: jax.Array, own: jax.Array, others: jax.Array) -> tuple[jax.Array, jax.Array]:
        actions = jnp.concatenate([own[None], others])
        draws = posterior.draws(critic, observation, actions, masks, config=config)
        guide = jnp.argmax(jnp.mean(draws[:, 1:], axis=0))
        return thompson.probability_better(draws, guide + 1, 0, config.estimator), guide

    return jax.lax.stop_gradient(jax.vmap(at_state)(batch.observation, action, advice))


def _means(
    critic: Params, observation: jax.Array, action: jax.Array, advice: jax.Array, *, config: SRLConfig
) -> tuple[jax.Array, jax.Array]:
    """What the mean critic holds of the student f32[B] and of its teachers f32[B, N]."""
    if config.values == "policy":
        actions = jnp.concatenate([action[:, None], advice], axis=1)
        both = jnp.mean(following.values(critic, observation, actions, config=config), axis=0)
        return both[:, 0], both[:, 1:]
    mean = lambda a: jnp.mean(ensemble.q_values(critic, observation, a, config=config), axis=0)  # noqa: E731
    return mean(action), jax.vmap(mean, 1, 1)(advice)


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
        target = td_target(state, part, teachers, config=config, hyper=hyper)
        loss = partial(posterior.critic_loss, batch=part, target=target, key=key, step=step, config=config, hyper=hyper)
        return ddpg.critic_step(state, loss, config=config, hyper=hyper)

    state, critic_metrics = ddpg.learn_critic(state, batch, critic_key, descend_critic, config=config, hyper=hyper)
    seen = ddpg.last_part(batch, config)
    guided = bool(teachers) and any(weight > 0.0 for weight in config.guidance_weight)

    def actor_loss(params: Params) -> tuple[jax.Array, Metrics]:
        action = student(params, seen.observation, config=config)
        q = ensemble.q_values(state.critic, seen.observation, action, config=config)
        q = jnp.mean(following.students(q, config=config))
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
        init=partial(init, config=config),
        act=partial(act, config=config),
        update=partial(update, config=config),
        metrics=METRICS,
        replays_healthy=max(config.prior_fraction) > 0.0,
        timed=config.segment > 0,
    )
