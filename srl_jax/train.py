"""The one compiled program: every lane's robots act, are simulated, remember and learn in one jitted `chunk`."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from srl_jax import replay as replays
from srl_jax.agents import ddpg, srl
from srl_jax.agents.ddpg import AgentState
from srl_jax.agents.hyper import Hyper
from srl_jax.bayes import controller
from srl_jax.blocks import blocked_map
from srl_jax.config import Config, DDPGConfig, SRLConfig
from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import ACTION_SIZE, EnvState, EnvStep, Hexapod
from srl_jax.lanes import Layout
from srl_jax.replay import Replay
from srl_jax.types import ActState, Params, Transition

AXIS = "lanes"


class Mode(NamedTuple):
    """Who acts and what comes of it; scalars, so that training, evaluation and collection are one program."""

    actor: jax.Array  # i32[] 0 the algorithm, noise included; 1 the student alone; 2 pi_B alone
    noise: jax.Array  # f32[] standard deviation of noise on pi_B's actions (actor 2)
    store: jax.Array  # bool[] whether transitions enter the replay
    learn: jax.Array  # bool[] whether agents update


def mode(actor: int, noise: float = 0.0, store: bool = False, learn: bool = False) -> Mode:
    """A `Mode` from plain values."""
    return Mode(jnp.int32(actor), jnp.float32(noise), jnp.bool_(store), jnp.bool_(learn))


TRAIN = partial(mode, 0, store=True, learn=True)
STUDENT = partial(mode, 1)
TEACHER = partial(mode, 2)
COLLECT = partial(mode, 2, store=True)


class LaneData(NamedTuple):
    """What distinguishes the rows and does not change while a chunk runs. R rows in all, n of one algorithm."""

    key: jax.Array  # key[R] stream of the lane's randomness
    damage: Damage  # leaves [R, ...]
    hyper: dict[str, Hyper]  # leaves [n]
    teachers: tuple[Params, ...]  # parameters of each teacher, leaves [R, ...]
    prior: dict[str, jax.Array]  # f32[n, P, W] healthy transitions, for algorithms that replay them


class World(NamedTuple):
    """Robots in the middle of their episodes."""

    env: EnvState  # leaves [R, E, ...]
    act: ActState  # leaves [R, E, ...]
    observation: jax.Array  # f32[R, E, O]
    episode: "Episode"  # leaves [R, E]


class Episode(NamedTuple):
    """Sums over the running episode of each environment, and how many episodes it has finished."""

    reward: jax.Array
    progress: jax.Array
    finished: jax.Array


class TrainState(NamedTuple):
    """Everything that training changes."""

    clock: jax.Array  # i32[] environment steps taken by every lane
    agents: dict[str, AgentState]  # leaves [n, ...]
    replay: Replay  # rows f32[R, C, W]
    world: World
    alive: jax.Array  # bool[R] False once a lane has met a number that is not finite; it is frozen then


class Tally(NamedTuple):
    """Sums over a chunk; a mean is a sum over its count."""

    episodes: jax.Array  # f32[R]
    totals: dict[str, jax.Array]  # f32[R] summed over finished episodes: return, distance, success, fell
    steps: jax.Array  # f32[R]
    rates: dict[str, jax.Array]  # f32[R] summed over environment steps: chosen_teacher, reward terms
    updates: jax.Array  # f32[]
    losses: dict[str, dict[str, jax.Array]]  # f32[n] summed over updates, per algorithm


@dataclasses.dataclass(frozen=True)
class Program:
    """The static parts that `chunk` is compiled from."""

    config: Config
    layout: Layout
    robot: Hexapod
    teachers: tuple[Callable[[Params, jax.Array], jax.Array], ...]  # (params, observation) -> action
    mesh: Mesh
    wide: bool  # an accelerator: no blocks

    def agent_config(self, algo: str) -> Any:
        return getattr(self.config, algo)

    @property
    def environments(self) -> int:
        return self.config.train.environments


def agent_module(config: DDPGConfig):
    """The triple of functions behind a configuration."""
    return srl if isinstance(config, SRLConfig) else ddpg


def sharding(program: Program) -> NamedSharding:
    """Rows laid over the program's devices."""
    return NamedSharding(program.mesh, P(AXIS))


def init_world(program: Program, keys: jax.Array, damage: Damage) -> World:
    """Fresh robots at the start of an episode, R rows of E, from the rows' keys."""
    count = program.environments

    def lane(key: jax.Array, damage_: Damage):
        return jax.vmap(lambda k: hexapod.reset(program.robot, damage_, k))(jax.random.split(key, count))

    env, observation = jax.vmap(lane)(keys, damage)
    zeros = jnp.zeros(observation.shape[:2])
    act = jax.tree.map(lambda x: jnp.broadcast_to(x, (*zeros.shape, *x.shape)), fresh_act_state())
    return World(env, act, observation, Episode(zeros, jnp.copy(zeros), jnp.copy(zeros)))


def fresh_act_state() -> ActState:
    """No noise, the student in command: the state of acting at the start of an episode."""
    return ActState(noise=jnp.zeros(ACTION_SIZE), guidance=controller.init())


def make_chunk(program: Program) -> Callable[[TrainState, LaneData, Mode, jax.Array], tuple[TrainState, Tally]]:
    """The jitted ``chunk(state, lanes, mode, n) -> (state, tally)``: n vector steps of every lane.

    `mode` and `n` are values, so one compilation serves training, evaluation, frozen pi_B and collection. `state` is
    donated. Rows never exchange anything: `shard_map` gives each device its own without collectives.
    """

    def local(state: TrainState, lanes: LaneData, mode_: Mode, n: jax.Array):
        carry = state, zero_tally(program, jnp.zeros(state.alive.shape), dict(program.layout.counts))
        return jax.lax.fori_loop(0, n, lambda _, c: vector_step(program, lanes, mode_, *c), carry)

    rows, same = P(AXIS), P()
    state_spec = TrainState(clock=same, agents=rows, replay=rows, world=rows, alive=rows)  # type: ignore[arg-type]
    tally_spec = Tally(rows, rows, rows, rows, same, rows)  # type: ignore[arg-type]
    mapped = jax.shard_map(
        local,
        mesh=program.mesh,
        in_specs=(state_spec, rows, same, same),
        out_specs=(state_spec, tally_spec),
        check_vma=False,
    )
    return jax.jit(mapped, donate_argnums=0)


def zero_tally(program: Program, zeros: Any, rows: dict[str, int]) -> Tally:
    """A tally of nothing yet.

    Args:
        program: static parts.
        zeros: f32[R], one zero per row.
        rows: how many of them each algorithm has.
    """
    terms = [f"reward_{name}" for name in hexapod.tasks.RewardTerms._fields]
    losses = {}
    for algo, count in rows.items():
        guided = isinstance(program.agent_config(algo), SRLConfig)
        losses[algo] = {name: zeros[:count] for name in ("critic_loss", "q", *(["p_guid"] if guided else []))}
    return Tally(
        episodes=zeros,
        totals={name: zeros for name in ("return", "distance", "success", "fell")},
        steps=zeros,
        rates={name: zeros for name in ("chosen_teacher", *terms)},
        updates=zeros[0],
        losses=losses,
    )


def vector_step(
    program: Program, lanes: LaneData, mode_: Mode, state: TrainState, tally: Tally
) -> tuple[TrainState, Tally]:
    """One control step of every robot on this device, and what is learned from it."""
    keys = jax.vmap(lambda k: jax.random.split(jax.random.fold_in(k, state.clock), 3))(lanes.key)
    action, act_state = act_rows(program, lanes, mode_, state, keys[:, 0])
    env, step = simulate_rows(program, lanes.damage, state.world.env, action)

    finite = jnp.isfinite(step.observation).all((1, 2)) & jnp.isfinite(step.reward).all(1)
    alive = state.alive & finite
    transition = Transition(
        observation=state.world.observation,
        action=action,
        reward=step.reward,
        discount=1.0 - step.terminated.astype(jnp.float32),
        next_observation=step.observation,
        chosen=act_state.guidance.choice.astype(jnp.float32),
    )
    memory = store(state.replay, transition, state.clock, mode_.store, alive)
    tally, episode = count_step(tally, state.world.episode, act_state, step, alive, first_only=~mode_.store)
    world = auto_reset(program, lanes, state.world, World(env, act_state, step.observation, episode), step, keys[:, 1], alive)

    clock = state.clock + program.environments
    state = TrainState(clock, state.agents, memory, world, alive)
    due = mode_.learn & (clock >= program.config.train.warmup)
    return jax.lax.cond(due, partial(learn_rows, program, lanes), lambda s, t, _: (s, t), state, tally, keys[:, 2])


def act_rows(
    program: Program, lanes: LaneData, mode_: Mode, state: TrainState, keys: jax.Array
) -> tuple[jax.Array, ActState]:
    """Every robot's action f32[R, E, 18]: its algorithm's, its student's, or pi_B's, as the mode says."""
    actions, act_states = [], []
    for algo, rows in program.layout.slices().items():
        lane = partial(act_lane, program, algo, mode_, state.clock)
        args = (
            state.agents[algo],
            jax.tree.map(lambda x, rows=rows: x[rows], (state.world.act, state.world.observation, keys, lanes.teachers)),
            lanes.hyper[algo],
        )
        action, act_state = jax.vmap(lane)(*args)
        actions.append(action)
        act_states.append(act_state)
    return jnp.concatenate(actions), jax.tree.map(lambda *x: jnp.concatenate(x), *act_states)


def act_lane(program: Program, algo: str, mode_: Mode, clock: jax.Array, agent: AgentState, rows: tuple, hyper: Hyper):
    """The actions f32[E, 18] of one lane's robots."""
    act_states, observations, key, teacher_params = rows
    config = program.agent_config(algo)
    teachers = bind_teachers(program, teacher_params)

    def one(act_state: ActState, observation: jax.Array, key_: jax.Array):
        own, new_state = agent_module(config).act(
            agent,
            act_state,
            observation,
            key_,
            config=config,
            hyper=hyper,
            step=clock.astype(jnp.float32),
            teachers=teachers,
        )
        alone = ddpg.student(agent.actor, observation, config=config)
        advised = jnp.clip(teachers[0](observation) + mode_.noise * new_state.noise, -1.0, 1.0)
        return jax.lax.select_n(mode_.actor, own, alone, advised), new_state

    return jax.vmap(one)(act_states, observations, jax.random.split(key, program.environments))


def bind_teachers(program: Program, params: tuple[Params, ...]) -> tuple[ddpg.Teacher, ...]:
    """The teachers as functions of the observation alone."""
    return tuple(partial(teacher, p) for teacher, p in zip(program.teachers, params, strict=True))


def simulate_rows(program: Program, damage: Damage, env: EnvState, action: jax.Array) -> tuple[EnvState, EnvStep]:
    """One control step of all robots, in blocks of lanes that fit the cache; the physics is traced here and only here."""
    lane = jax.vmap(partial(hexapod.step, program.robot), (None, 0, 0))  # the robots of a lane share its damage
    step = jax.vmap(lane)
    block = 0 if program.wide else program.config.train.physics_block
    return blocked_map(lambda args: step(*args), (damage, env, action), block)


def store(memory: Replay, transition: Transition, clock: jax.Array, wanted: jax.Array, alive: jax.Array) -> Replay:
    """Writes the transitions of all rows at the shared clock; unwanted ones write back what is there.

    A write under a batched predicate would copy the whole buffer.
    """
    new = replays.pack(transition)
    start = (0, clock % memory.rows.shape[1], 0)
    old = jax.lax.dynamic_slice(memory.rows, start, new.shape)
    rows = jnp.where((wanted & alive)[:, None, None], new, old)
    return Replay(jax.lax.dynamic_update_slice(memory.rows, rows, start))


def count_step(
    tally: Tally, episode: Episode, act_state: ActState, step: EnvStep, alive: jax.Array, *, first_only: jax.Array
) -> tuple[Tally, Episode]:
    """Adds one vector step to the running episodes and, of those that end, to the tally.

    An evaluation counts the first episode of each robot only: short ones would otherwise count more often.
    """
    weight = alive.astype(jnp.float32)
    done = (step.terminated | step.truncated).astype(jnp.float32) * weight[:, None]
    counted = done * (~first_only | (episode.finished == 0.0))
    reward, progress = episode.reward + step.reward, episode.progress + step.progress
    ended = {"return": reward, "distance": progress, "success": step.success, "fell": step.fell}
    rates = {"chosen_teacher": act_state.guidance.choice > 0}
    rates |= {f"reward_{name}": value for name, value in step.terms._asdict().items()}
    tally = tally._replace(
        episodes=tally.episodes + counted.sum(1),
        totals={name: tally.totals[name] + (counted * value).sum(1) for name, value in ended.items()},
        steps=tally.steps + weight * done.shape[1],
        rates={name: tally.rates[name] + weight * value.astype(jnp.float32).sum(1) for name, value in rates.items()},
    )
    going = 1.0 - done
    return tally, Episode(reward * going, progress * going, episode.finished + done)


def auto_reset(
    program: Program, lanes: LaneData, before: World, after: World, step: EnvStep, keys: jax.Array, alive: jax.Array
) -> World:
    """Starts a new episode where one has ended; the robots of a frozen lane stay where they were."""
    fresh = init_world(program, keys, lanes.damage)
    done = step.terminated | step.truncated
    fresh = fresh._replace(episode=after.episode)

    def pick(old: jax.Array, new: jax.Array, start: jax.Array) -> jax.Array:
        extra = (1,) * (new.ndim - 2)
        new = jnp.where(done.reshape(*done.shape, *extra), start, new)
        return jnp.where(alive.reshape(-1, 1, *extra), new, old)

    return jax.tree.map(pick, before, after, fresh)


def learn_rows(
    program: Program, lanes: LaneData, state: TrainState, tally: Tally, keys: jax.Array
) -> tuple[TrainState, Tally]:
    """`config.train.updates` mini-batch updates of every lane's agent."""

    def once(i, carry):
        state, tally = carry
        update_keys = jax.vmap(lambda k: jax.random.split(jax.random.fold_in(k, i), 3))(keys)
        batches = sample_rows(program, state, update_keys[:, 0])
        agents, losses, ok = dict(state.agents), dict(tally.losses), []
        for algo, rows in program.layout.slices().items():
            agents[algo], metrics, finite = learn_algo(program, algo, lanes, state, batches[rows], update_keys[rows, 1:])
            losses[algo] = {k: losses[algo][k] + jnp.where(finite, metrics[k], 0.0) for k in losses[algo]}
            ok.append(finite)
        state = state._replace(agents=agents, alive=state.alive & jnp.concatenate(ok))
        return state, tally._replace(losses=losses, updates=tally.updates + 1.0)

    return jax.lax.fori_loop(0, program.config.train.updates, once, (state, tally))


def sample_rows(program: Program, state: TrainState, keys: jax.Array) -> jax.Array:
    """Packed mini-batches f32[R, B, W] of all rows by one gather; B is the largest batch of any algorithm."""
    size = max(program.agent_config(algo).batch for algo, _ in program.layout.counts)
    filled = jnp.minimum(state.clock, state.replay.rows.shape[1])
    index = jax.vmap(lambda k: jax.random.randint(k, (size,), 0, filled))(keys)
    return jax.vmap(lambda rows, i: rows[i])(state.replay.rows, index)


def learn_algo(
    program: Program, algo: str, lanes: LaneData, state: TrainState, batches: jax.Array, keys: jax.Array
) -> tuple[AgentState, dict[str, jax.Array], jax.Array]:
    """One update of one algorithm's lanes, in cache-sized blocks; also which of them stayed finite, bool[n]."""
    config, rows = program.agent_config(algo), program.layout.slices()[algo]
    observation_size = state.world.observation.shape[-1]
    step = state.clock.astype(jnp.float32)

    def lane(args):
        agent, batch, key, hyper, teacher_params, alive = args
        new, metrics = agent_module(config).update(
            agent,
            replays.unpack(batch[: config.batch], observation_size),
            key,
            config=config,
            hyper=hyper,
            step=step,
            teachers=bind_teachers(program, teacher_params),
        )
        sums = [jnp.sum(leaf) for leaf in jax.tree.leaves((new.actor, new.critic, metrics))]
        finite = alive & jnp.isfinite(jnp.stack(sums)).all()
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
