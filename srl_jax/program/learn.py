"""The learning half of the compiled program: mini-batches for every row, and every algorithm's update on its rows."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from srl_jax.agents import registry
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.settings import ActorConfig, AgentConfig
from srl_jax.blocks import blocked_map
from srl_jax.program import replay as replays
from srl_jax.program.state import LaneData, Program, Tally, TrainState, bind_teachers
from srl_jax.types import EndedEpisodes


def learn_rows(
    program: Program, lanes: LaneData, state: TrainState, tally: Tally, keys: jax.Array
) -> tuple[TrainState, Tally]:
    """One update of every lane's agent."""
    keys = jax.vmap(lambda k: jax.random.split(k, 3))(keys)
    batches = sample_rows(program, state, keys[:, 0])
    agents, losses, ok = dict(state.agents), dict(tally.losses), []
    for algo, rows in program.layout.slices().items():
        agents[algo], metrics, finite = learn_algo(program, algo, lanes, state, batches[rows], keys[rows, 1:])
        losses[algo] = {k: losses[algo][k] + jnp.where(finite, metrics[k], 0.0) for k in losses[algo]}
        ok.append(finite)
    state = state._replace(agents=agents, alive=state.alive & jnp.concatenate(ok))
    return state, tally._replace(losses=losses, updates=tally.updates + 1.0)


def batch_size(config: AgentConfig) -> int:
    """Transitions that one update of an agent takes; none for those that do not replay."""
    return config.batch * getattr(config, "critic_updates", 1) if isinstance(config, ActorConfig) else 0


def sample_rows(program: Program, state: TrainState, keys: jax.Array) -> jax.Array:
    """Packed mini-batches f32[R, B, W] of all rows; B is the largest batch of any algorithm."""
    size = max(batch_size(program.agent_config(algo)) for algo, _ in program.layout.counts)
    filled = jnp.minimum(state.clock, state.replay.rows.shape[1])
    return jax.vmap(lambda memory, key: replays.draw(memory, filled, size, key))(state.replay, keys)


def learn_algo(
    program: Program, algo: str, lanes: LaneData, state: TrainState, batches: jax.Array, keys: jax.Array
) -> tuple[Any, dict[str, jax.Array], jax.Array]:
    """One update of one algorithm's lanes, in cache-sized blocks; also which of them stayed finite, bool[n]."""
    config, rows = program.agent_config(algo), program.layout.slices()[algo]
    observation_size = state.world.observation.shape[-1]
    step = state.clock.astype(jnp.float32)

    def lane(args):
        agent, batch, key, hyper, teacher_params, alive = args
        new, metrics = registry.module(config).update(
            agent,
            replays.unpack(batch[: batch_size(config)], observation_size),
            key,
            config=config,
            hyper=hyper,
            step=step,
            teachers=bind_teachers(program, algo, teacher_params),
        )
        sums = [jnp.sum(leaf) for leaf in jax.tree.leaves((new.actor, new.critic, metrics))]
        finite = alive & jnp.isfinite(jnp.array(sums)).all()
        return jax.tree.map(lambda n, o: jnp.where(finite, n, o), new, agent), metrics, finite

    if algo in lanes.prior:
        batches = mix_prior(batches, lanes.prior[algo], keys[:, 1], lanes.hyper[algo], step)
    teacher_params = jax.tree.map(lambda x: x[rows], lanes.teachers)
    args = (state.agents[algo], batches, keys[:, 0], lanes.hyper[algo], teacher_params, state.alive[rows])
    return blocked_map(jax.vmap(lane), args, 0 if program.wide else program.config.train.update_block)


def mix_prior(batches: jax.Array, prior: jax.Array, keys: jax.Array, hyper: Hyper, step: jax.Array) -> jax.Array:
    """Replaces a decaying fraction of each mini-batch by healthy transitions (Sec. "prior replays")."""

    def lane(batch: jax.Array, healthy: jax.Array, key: jax.Array, hyper_: Hyper) -> jax.Array:
        index_key, pick_key = jax.random.split(key)
        fraction = hyper_.prior_fraction * jnp.maximum(1.0 - step / hyper_.prior_decay, 0.0)
        rows = healthy[jax.random.randint(index_key, (len(batch),), 0, len(healthy))]
        return jnp.where(jax.random.uniform(pick_key, (len(batch), 1)) < fraction, rows, batch)

    return jax.vmap(lane)(batches, prior, keys, hyper)


def learn_episodes(
    program: Program, lanes: LaneData, agents: dict[str, Any], episodes: EndedEpisodes
) -> dict[str, Any]:
    """The agents after the episodic ones among them were shown the episodes that have just ended, leaves [R, E]."""
    agents = dict(agents)
    for algo, rows in program.layout.slices().items():
        if registry.is_episodic(program.agent_config(algo)):
            own = jax.tree.map(lambda x, rows=rows: x[rows], episodes)
            learn = partial(finish_algo, program, algo, lanes.hyper[algo], own)
            # EndedEpisodes mostly end together: at all other steps nothing is computed.
            agents[algo] = jax.lax.cond(jnp.any(own.ended), learn, lambda agent: agent, agents[algo])
    return agents


def finish_algo(program: Program, algo: str, hyper: Hyper, episodes: EndedEpisodes, agents: Any) -> Any:
    """One episodic algorithm's lanes after their episodes.

    On a CPU lane by lane: most have no news, and only without `vmap` does a `cond` of theirs skip anything.
    """
    config = program.agent_config(algo)
    finish = partial(registry.module(config).finish, config=config)
    rows = (agents, episodes, hyper)
    each = lambda lane: finish(*lane[:2], hyper=lane[2])  # noqa: E731
    return jax.vmap(each)(rows) if program.wide else jax.lax.map(each, rows)
