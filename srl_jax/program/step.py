"""The one compiled program: every lane's robots act, are simulated, remember and learn in one jitted `chunk`."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jax.sharding import PartitionSpec

from srl_jax.blocks import blocked_map
from srl_jax.env import hexapod, physics
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState, EnvStep
from srl_jax.program import mix
from srl_jax.program import replay as replays
from srl_jax.program.act import act_rows, init_world
from srl_jax.program.learn import learn_episodes, take_turn
from srl_jax.program.randomness import Stream, at_step, per_robot
from srl_jax.program.state import AXIS, LaneData, Mode, Program, TrainState, World
from srl_jax.program.tally import Tally, count_step
from srl_jax.types import ActState, EndedEpisodes, Transition

LOTS = 2**24  # whole numbers below it are exact in f32

Chunk = Callable[[TrainState, Tally, LaneData, Mode, jax.Array], tuple[TrainState, Tally]]


def make_chunk(program: Program) -> Chunk:
    """The jitted ``chunk(state, tally, lanes, mode, n) -> (state, tally)``: n vector steps of every lane.

    `mode` and `n` are values, so one compilation serves training, evaluation, frozen pi_B and collection. `state` and
    `tally` are donated; the tally goes on counting, so that how steps are cut into chunks changes no digit. Rows never
    exchange anything: `shard_map` gives each device its own without collectives.
    """

    def local(state: TrainState, tally: Tally, lanes: LaneData, mode: Mode, n: jax.Array):
        return jax.lax.fori_loop(0, n, lambda _, c: vector_step(program, lanes, mode, *c), (state, tally))

    rows, same = PartitionSpec(AXIS), PartitionSpec()
    state_spec = TrainState(clock=same, agents=rows, replay=rows, world=rows, alive=rows)  # type: ignore[arg-type]
    tally_spec = Tally(rows, rows, rows, rows, same, rows)  # type: ignore[arg-type]
    mapped = jax.shard_map(
        local,
        mesh=program.mesh,
        in_specs=(state_spec, tally_spec, rows, same, same),
        out_specs=(state_spec, tally_spec),
        check_vma=False,
    )
    return jax.jit(mapped, donate_argnums=(0, 1))


def vector_step(
    program: Program, lanes: LaneData, mode: Mode, state: TrainState, tally: Tally
) -> tuple[TrainState, Tally]:
    """One control step of every robot on this device, and what is learned from it."""
    action, act_state = act_rows(program, lanes, mode, state)
    env, step = simulate_rows(program, lanes.damage, state.world, action)

    finite = jnp.isfinite(step.observation).all((1, 2)) & jnp.isfinite(step.reward).all(1)
    alive = state.alive & finite
    episodes = ended_episodes(program, state, act_state, env, step, alive & mode.learn)
    agents = learn_episodes(program, lanes, state.agents, episodes)
    tally, episode = count_step(tally, state.world.episode, act_state, step, alive, first_only=~mode.store)
    after = state.world._replace(env=env, act=act_state, observation=step.observation, episode=episode)
    world = auto_reset(program, lanes, state, after, step, alive)

    memory = remember(program, lanes, state, action, act_state, step, world, mode.store & alive)
    clock = state.clock + program.environments
    state = TrainState(clock, agents, memory, world, alive)
    if not any(agent.update for agent in program.agents.values()):
        return state, tally
    turn = (clock // program.environments) % program.settings.update_every == 0
    due = mode.learn & (clock >= program.settings.warmup) & turn
    return jax.lax.cond(due, partial(take_turn, program, lanes), lambda s, t: (s, t), state, tally)


def simulate_rows(program: Program, damage: Damage, world: World, action: jax.Array) -> tuple[EnvState, EnvStep]:
    """One control step of all robots, in blocks that fit the cache; physics is traced here and only here."""
    count = program.environments
    block = 0 if program.wide else physics.together(program.robot.star, program.settings.physics_block * count)
    # One flat axis of robots: with lanes and robots as two axes, MJX's small products are a sixth slower.
    if world.drawn is None:
        own = jax.tree.map(lambda x: jnp.repeat(x, count, axis=0), damage)
    else:
        own = _flat(jax.vmap(mix.taken)(damage, world.drawn))
    rows = (own, *_flat((world.env, action)))
    flat = blocked_map(lambda args: jax.vmap(partial(hexapod.step, program.robot))(*args), rows, block)
    return jax.tree.map(lambda x: x.reshape(-1, count, *x.shape[1:]), flat)


def _flat(rows):
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), rows)


def remember(
    program: Program,
    lanes: LaneData,
    state: TrainState,
    action: jax.Array,
    act_state: ActState,
    step: EnvStep,
    after: World,
    wanted: jax.Array,
) -> dict[str, replays.Replay]:
    """The replays after this step's transitions, of the `wanted` bool[R] rows of algorithms that replay."""
    keys = at_step(lanes.key, state.clock, Stream.LOT)
    lots = jax.vmap(lambda key: jax.random.randint(key, (program.environments,), 0, LOTS))(keys)
    transition = Transition(
        observation=state.world.observation,
        action=action,
        reward=step.reward,
        discount=1.0 - step.terminated.astype(jnp.float32),
        next_observation=step.observation,
        chosen=act_state.guidance.choice.astype(jnp.float32),
        lot=lots.astype(jnp.float32),
    )
    rows, now = program.layout.slices(), state.clock // program.environments
    write = partial(replays.add, step=now, episode_steps=program.sizes.episode_steps)
    new = (transition, step.truncated, after.observation)
    own = {algo: jax.tree.map(lambda x, algo=algo: x[rows[algo]], (*new, wanted)) for algo in state.replay}
    return {algo: write(state.replay[algo], *new, wanted=wanted) for algo, (*new, wanted) in own.items()}


def ended_episodes(
    program: Program, state: TrainState, act_state: ActState, env: EnvState, step: EnvStep, learning: jax.Array
) -> EndedEpisodes:
    """The episodes that this step has ended, leaves [R, E]; none of them in rows that are not `learning` bool[R]."""
    now = state.clock // program.environments + 1
    running = state.world.episode
    assert act_state.seed is not None
    return EndedEpisodes(
        ended=(step.terminated | step.truncated) & learning[:, None],
        seed=act_state.seed,
        returns=running.reward + step.reward,
        distance=running.progress + step.progress,
        began=now - env.steps,
        now=jnp.full_like(env.steps, now),
    )


def auto_reset(
    program: Program, lanes: LaneData, state: TrainState, after: World, step: EnvStep, alive: jax.Array
) -> World:
    """Starts a new episode where one has ended; the robots of a frozen lane stay where they were."""
    keys = per_robot(at_step(lanes.key, state.clock, Stream.RESET), 0, program.environments)
    fresh = init_world(program, keys, lanes.damage, lanes.starts)._replace(episode=after.episode)
    done = step.terminated | step.truncated

    def pick(old: jax.Array, new: jax.Array, start: jax.Array) -> jax.Array:
        extra = (1,) * (new.ndim - 2)
        new = jnp.where(done.reshape(*done.shape, *extra), start, new)
        return jnp.where(alive.reshape(-1, 1, *extra), new, old)

    return jax.tree.map(pick, state.world, after, fresh)
