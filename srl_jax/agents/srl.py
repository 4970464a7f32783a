"""Survivable robotic learning (Raza et al. 2021): DDPG whose critic is a posterior that weighs pi_B's advice.

Parts as in the paper: proposals and Thompson's sample with commitment (`act`), the posterior's likelihood
(`critic_loss`), the behaviour target (`next_action`) and guidance of the actor's gradient (`guidance`). The start
from pi_B and the healthy replay are the caller's: they change the initial actor and the batch, not the update.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp

from srl_jax.agents import ddpg, noise
from srl_jax.agents.ddpg import AgentState, critic_fn, student
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Agent, Metrics, Teacher
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import controller, dropout, thompson
from srl_jax.types import ActState, Params, Transition

init = ddpg.init
METRICS = (*ddpg.METRICS, "p_guid")


def posterior_masks(key: jax.Array, *, config: SRLConfig, hyper: Hyper, proposals: int = 0) -> tuple:
    """Masks of `config.draws` posterior samples: f32[K, M / K, H] per layer ([K, M / K, N, H] unless shared)."""
    shape = (config.critics, config.draws // config.critics)
    if proposals and not config.shared_masks:
        shape = (*shape, proposals)
    return dropout.sample_masks(key, config.hidden, shape, hyper.dropout)


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
        masks = posterior_masks(mask_key, config=config, hyper=hyper, proposals=len(actions))
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


def critic_loss(
    params: Params, batch: Transition, target: jax.Array, key: jax.Array, *, config: SRLConfig, hyper: Hyper
) -> tuple[jax.Array, Metrics]:
    """The dropout likelihood (Gal & Ghahramani 2016), or AC-Teach's alpha-divergence over posterior samples.

    td: ``sum_k mean_b w_kb (Q_k(s, a; mask) - y)^2 + lambda ||phi||^2`` with bootstrap weights w.
    alpha: ``mean_b -(1/alpha) logsumexp_m[-(alpha tau / 2) (y - Q_m)^2] + lambda ||phi||^2``.
    """
    size = batch.reward.shape[0]
    mask_key, bootstrap_key = jax.random.split(key)
    penalty = hyper.weight_decay * sum(jnp.sum(jnp.square(p)) for p in jax.tree.leaves(params))
    if config.critic_loss == "alpha":
        masks = posterior_masks(mask_key, config=config, hyper=hyper)
        over_batch = jax.vmap(dropout.q_draws, (None, None, 0, 0, None))
        q = over_batch(critic_fn(config), params, batch.observation, batch.action[:, None], masks)[..., 0]
        energy = -0.5 * hyper.alpha * hyper.precision * jnp.square(target[:, None] - q)
        loss = -jnp.mean(jax.nn.logsumexp(energy, axis=1)) / hyper.alpha
        return loss + penalty, {"critic_loss": loss}
    masks = None
    if config.dropout_update:
        masks = dropout.sample_masks(mask_key, config.hidden, (config.critics, size), hyper.dropout)
    q = jax.vmap(critic_fn(config), (0, None, None, 0))(params, batch.observation, batch.action, masks)
    weight = jax.random.bernoulli(bootstrap_key, hyper.bootstrap, q.shape).astype(q.dtype)
    loss = jnp.mean(weight * jnp.square(q - target[None]), axis=1).sum()
    return loss + penalty, {"critic_loss": loss / config.critics}


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
) -> jax.Array:
    """``p_guid(s) = P[Q(s, pi_B(s)) > Q(s, pi(s))]`` of every teacher, over the same samples for both.

    `config.guidance_weighting` has two controls in its place: the mean critic's verdict, and a function of time alone.

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
        f32[B, N], without gradient.
    """
    if config.guidance_weighting == "annealed":
        return jnp.full(advice.shape[:2], jnp.maximum(1.0 - step / hyper.guidance_decay, 0.0))
    if config.guidance_weighting == "mean":
        mean = lambda a: jnp.mean(ddpg.ensemble_q(critic, batch.observation, a, config=config), axis=0)  # noqa: E731
        better = jax.vmap(mean, 1, 1)(advice) > mean(action)[:, None]
        return jax.lax.stop_gradient(better.astype(action.dtype))
    shape = (config.critics, config.guidance_draws // config.critics)
    masks = dropout.sample_masks(key, config.hidden, shape, hyper.dropout)

    def at_state(observation: jax.Array, own: jax.Array, others: jax.Array) -> jax.Array:
        actions = jnp.concatenate([own[None], others])
        draws = dropout.q_draws(critic_fn(config), critic, observation, actions, masks)
        better = lambda i: thompson.probability_better(draws, i, 0, config.estimator)  # noqa: E731
        return jax.vmap(better)(jnp.arange(1, len(actions)))

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

    The actor descends ``-mean_k Q_k(s, pi(s)) + g p_guid(s) ||pi(s) - pi_B(s)||^2`` (Sec. "Partially Guidance").

    Returns:
        The new state and scalar metrics ``critic_loss``, ``q``, ``p_guid``.
    """
    critic_key, guidance_key = jax.random.split(key)

    def descend_critic(state: AgentState, part: Transition, key: jax.Array) -> tuple[AgentState, Metrics]:
        chosen = next_action(state, part, teachers, config=config)
        target = ddpg.td_target(state, part, chosen, config=config, hyper=hyper)
        loss = lambda params: critic_loss(params, part, target, key, config=config, hyper=hyper)  # noqa: E731
        return ddpg.critic_step(state, loss, config=config, hyper=hyper)

    state, critic_metrics = ddpg.learn_critic(state, batch, critic_key, descend_critic, config=config, hyper=hyper)
    seen = ddpg.last_part(batch, config)
    guided = bool(teachers) and any(weight > 0.0 for weight in config.guidance_weight)

    def actor_loss(params: Params) -> tuple[jax.Array, Metrics]:
        action = student(params, seen.observation, config=config)
        q = jnp.mean(ddpg.ensemble_q(state.critic, seen.observation, action, config=config))
        if not guided:
            return -q, {"q": q, "p_guid": jnp.zeros(())}
        advice = jnp.stack([jax.vmap(teacher)(seen.observation) for teacher in teachers], axis=1)
        own = jax.lax.stop_gradient(action)
        p_guid = guidance(state.critic, seen, own, advice, guidance_key, config=config, hyper=hyper, step=step)
        distance = jnp.sum(jnp.square(action[:, None] - advice), axis=-1)
        pull = hyper.guidance_weight * jnp.mean(p_guid * distance)
        return pull - q, {"q": q, "p_guid": jnp.mean(p_guid)}

    state, actor_metrics = ddpg.actor_step(state, actor_loss, config=config, hyper=hyper, step=step)
    target_actor = ddpg.track(state.actor, state.target_actor, hyper=hyper)
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
