"""The learning half of the compiled program: mini-batches for every row, and every algorithm's update on its rows."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from srl_jax.agents.hyper import Hyper
from srl_jax.blocks import blocked_map
from srl_jax.program import replay as replays
from srl_jax.program.randomness import Stream, at_step
from srl_jax.program.state import LaneData, Program, TrainState, bind_teachers
from srl_jax.program.tally import Tally
from srl_jax.types import EndedEpisodes, Transition


def take_turn(program: Program, lanes: LaneData, state: TrainState, tally: Tally) -> tuple[TrainState, Tally]:
    """The updates of every lane's agent that are due at once."""
    count = program.settings.updates
    if count == 1:
        return learn_rows(program, lanes, state, tally)
    learn = lambda number, carry: learn_rows(program, lanes, *carry, number=number)  # noqa: E731
    return jax.lax.fori_loop(0, count, learn, (state, tally))


def learn_rows(
    program: Program, lanes: LaneData, state: TrainState, tally: Tally, number: jax.Array | int = 0
) -> tuple[TrainState, Tally]:
    """One update of every lane's agent, of those algorithms that update; the `number`-th of its turn."""
    agents, losses, ok = dict(state.agents), dict(tally.losses), []
    for algo, rows in program.layout.slices().items():
        if program.agents[algo].update is None:
            ok.append(state.alive[rows])
            continue
        agents[algo], metrics, finite = learn_algo(program, algo, lanes, state, number)
        losses[algo] = {k: losses[algo][k] + jnp.where(finite, metrics[k], 0.0) for k in losses[algo]}
        ok.append(finite)
    state = state._replace(agents=agents, alive=state.alive & jnp.concatenate(ok))
    return state, tally._replace(losses=losses, updates=tally.updates + 1.0)


def learn_algo(
    program: Program, algo: str, lanes: LaneData, state: TrainState, number: jax.Array | int = 0
) -> tuple[Any, dict[str, jax.Array], jax.Array]:
    """One update of one algorithm's lanes, in cache-sized blocks; also which of them stayed finite, bool[n]."""
    update, rows = program.agents[algo].update, program.layout.slices()[algo]
    assert update is not None
    step = state.clock.astype(jnp.float32)
    moment = state.clock * program.settings.updates + number  # as the clock, where a turn is one update

    def lane(args):
        agent, transitions, key, hyper, teacher_params, alive = args
        teachers = bind_teachers(program, algo, teacher_params)
        new, metrics = update(agent, transitions, key, hyper=hyper, step=step, teachers=teachers)
        sums = [jnp.sum(leaf) for leaf in jax.tree.leaves((new.actor, new.critic, metrics))]
        finite = alive & jnp.isfinite(jnp.array(sums)).all()
        return jax.tree.map(lambda n, o: jnp.where(finite, n, o), new, agent), metrics, finite

    own_keys = lanes.key[rows]
    batches = draw_batches(program, algo, state, at_step(own_keys, moment, Stream.BATCH))
    if algo in lanes.prior:
        mix_keys = at_step(own_keys, moment, Stream.MIX)
        batches = mix_prior(batches, lanes.prior[algo], mix_keys, lanes.hyper[algo], step)
    teacher_params = jax.tree.map(lambda x: x[rows], lanes.teachers)
    keys = at_step(own_keys, moment, Stream.UPDATE)
    args = (state.agents[algo], batches, keys, lanes.hyper[algo], teacher_params, state.alive[rows])
    return blocked_map(jax.vmap(lane), args, 0 if program.wide else program.settings.update_block)


def draw_batches(program: Program, algo: str, state: TrainState, keys: jax.Array) -> Transition:
    """Mini-batches of one algorithm's rows, leaves [n, B, ...]."""
    size, now = program.agents[algo].batch_size, state.clock // program.environments
    return jax.vmap(lambda memory, key: replays.draw(memory, now, size, key, program.sizes))(state.replay[algo], keys)


def mix_prior(batches: Transition, prior: Transition, keys: jax.Array, hyper: Hyper, step: jax.Array) -> Transition:
    """Replaces a decaying fraction of each mini-batch by healthy transitions (SRL, Raza et al. 2021: "prior replays").

    Args:
        batches: leaves [n, B, ...].
        prior: healthy transitions, leaves [n, P, ...].
        keys: key[n].
        hyper: with `prior_fraction` and `prior_decay`, f32[n].
        step: f32[] environment steps taken so far.
    """

    def lane(batch: Transition, healthy: Transition, key: jax.Array, hyper_: Hyper) -> Transition:
        index_key, pick_key = jax.random.split(key)
        fraction = hyper_.prior_fraction * jnp.maximum(1.0 - step / hyper_.prior_decay, 0.0)
        index = jax.random.randint(index_key, batch.reward.shape, 0, len(healthy.reward))
        picked = jax.random.uniform(pick_key, batch.reward.shape) < fraction

        def mixed(own: jax.Array, other: jax.Array) -> jax.Array:
            return jnp.where(picked.reshape(-1, *(1,) * (own.ndim - 1)), other[index], own)

        return jax.tree.map(mixed, batch, healthy)

    return jax.vmap(lane)(batches, prior, keys, hyper)


def learn_episodes(
    program: Program, lanes: LaneData, agents: dict[str, Any], episodes: EndedEpisodes
) -> dict[str, Any]:
    """The agents after the episodic ones among them were shown the episodes that have just ended, leaves [R, E]."""
    agents = dict(agents)
    for algo, rows in program.layout.slices().items():
        if program.agents[algo].finish:
            own = jax.tree.map(lambda x, rows=rows: x[rows], episodes)
            learn = partial(finish_algo, program, algo, lanes.hyper[algo], own)
            # Episodes mostly end together: at all other steps nothing is computed.
            agents[algo] = jax.lax.cond(jnp.any(own.ended), learn, lambda agent: agent, agents[algo])
    return agents


def finish_algo(program: Program, algo: str, hyper: Hyper, episodes: EndedEpisodes, agents: Any) -> Any:
    """One episodic algorithm's lanes after their episodes.

    On a CPU lane by lane: most have no news, and only without `vmap` does a `cond` of theirs skip anything.
    """
    finish = program.agents[algo].finish
    assert finish is not None
    rows = (agents, episodes, hyper)
    each = lambda lane: finish(*lane[:2], hyper=lane[2])  # noqa: E731
    return jax.vmap(each)(rows) if program.wide else jax.lax.map(each, rows)
