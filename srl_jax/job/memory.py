"""What a run will cost in memory and operations, by arithmetic before anything is allocated; waves of lanes to fit."""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax

from srl_jax.agents import registry
from srl_jax.agents.settings import DDPGConfig
from srl_jax.agents.sweep import AgentSettings
from srl_jax.config import Config
from srl_jax.env import damage as damages
from srl_jax.env.anatomy import Anatomy
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import observation_size, state_size
from srl_jax.job.plan import parse_mix
from srl_jax.program import replay as replays
from srl_jax.program import strides
from srl_jax.program.lanes import Lane, lay_out
from srl_jax.program.replay import Sizes
from srl_jax.program.state import tuned_gait

BASE = 2**30  # the process with its libraries and programs


class Bytes(NamedTuple):
    """What a run allocates, by purpose. A checkpoint copies what the next chunk would write into."""

    replay: int
    agents: int
    checkpoint: int
    program: int
    mix: int = 0  # damages that robots draw from, and what starts there are of each

    def __str__(self) -> str:
        some = {name: value for name, value in self._asdict().items() if value or name != "mix"}
        parts = " + ".join(f"{value / 2**30:.2f} GiB {name}" for name, value in some.items())
        return f"{parts} = {sum(self) / 2**30:.2f} GiB"


def needed(config: Config, lanes: Sequence[Lane], devices: int) -> Bytes:
    """The arithmetic for lanes that are trained at once: their replays and networks."""
    replay, copied, agents, mixes = 0, 0, 0, 0
    for algo, count in lay_out(lanes, devices).counts:
        rows = count * devices
        agents += rows * agent_bytes(config, algo)
        mixes += rows * mix_bytes(config)
        if registry.agent(config.agent(algo)).replays:
            replay += rows * replay_bytes(config, config.train.capacity)
            copied += rows * replay_bytes(config, min(config.train.capacity, config.steps))
    return Bytes(replay, agents, copied + agents, BASE, mixes)


def replay_bytes(config: Config, capacity: int) -> int:
    """Bytes of one lane's replay of so many transitions."""
    sizes = Sizes(_observed(config), config.anatomy.action_size, config.env.episode_steps)
    return replays.size(capacity, config.train.environments, sizes)


def _observed(config: Config) -> int:
    return observation_size(config.task, config.env, config.anatomy)


def mix_bytes(config: Config) -> int:
    """Bytes of one lane's mix of damages, and of the robots in mid-stride that episodes start from; 0 without a mix."""
    own = sum(leaf.nbytes for leaf in damages.build(HEALTHY, config.anatomy))
    starts = strides.COUNT * 4 * state_size(config.env, config.anatomy) if config.env.stride_starts else 0
    return len(parse_mix(config)) * (own + starts)


def agent_bytes(config: Config, algo: str) -> int:
    """Bytes of one lane's agent, optimisers included, without allocating it."""
    shapes = _shapes(config.agent(algo), _observed(config), config.anatomy)
    return sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(shapes))


@cache
def _shapes(settings: AgentSettings, size: int, anatomy: Anatomy) -> Any:
    agent, teachers = registry.agent(settings), (tuned_gait(anatomy),)
    return jax.eval_shape(lambda key: agent.init(key, size, anatomy.action_size, teachers=teachers), jax.random.key(0))


def waves(config: Config, lanes: Sequence[Lane], devices: int) -> list[list[Lane]]:
    """The lanes in as few parts as fit `memory_gb`, each with its share of every algorithm; mostly all in one.

    Raises:
        ValueError: not even one lane of each algorithm and device fits.
    """
    by_algo: dict[str, list[Lane]] = {}
    for lane in lanes:
        by_algo.setdefault(lane.algo, []).append(lane)
    limit, most = config.memory_gb * 2**30, max(len(own) for own in by_algo.values())
    least = needed(config, _part(by_algo, 0, most), devices)
    if sum(least) > limit:
        raise ValueError(
            f"memory_gb is {config.memory_gb:g}, but a single lane of each algorithm needs more ({least}); "
            "raise it, or lower train.capacity."
        )
    parts = next(n for n in range(1, most + 1) if sum(needed(config, _part(by_algo, 0, n), devices)) <= limit)
    return [_part(by_algo, number, parts) for number in range(parts)]


def _part(by_algo: dict[str, list[Lane]], number: int, parts: int) -> list[Lane]:
    """Part `number` of every algorithm's lanes, in blocks of equal size, so that all parts compile to one program."""
    found = []
    for own in by_algo.values():
        size = -(-len(own) // parts)
        found += own[number * size : (number + 1) * size]
    return found


def operations(config: Config, lanes: Mapping[str, int]) -> float:
    """Floating-point operations of the updates of all lanes, at least: products of matrices in actor and critics.

    Args:
        config: of the run.
        lanes: how many each algorithm has.
    """
    updates = config.steps / config.train.steps_an_update
    total = 0.0
    for algo, count in lanes.items():
        settings, agent = config.agent(algo), registry.agent(config.agent(algo))
        if not agent.replays or agent.network is None:
            continue
        shapes = _shapes(settings, _observed(config), config.anatomy)
        actor, critic = (sum(x.size for x in jax.tree.leaves(part)) for part in (shapes.actor, shapes.critic))
        steps = settings.critic_updates if isinstance(settings, DDPGConfig) else 1
        # Forward 2 operations a parameter and sample, backward 4; the critic's target, its step, then the actor's step.
        each = agent.batch_size * (2 * (actor + critic) + 6 * critic) + agent.batch_size / steps * 6 * (actor + critic)
        total += each * updates * count
    return total


def describe(config: Config, parts: Sequence[Sequence[Lane]], devices: int) -> str:
    """What a run will cost, in a sentence or two for the reader of a terminal."""
    lanes = [lane for part in parts for lane in part]
    cost = needed(config, parts[0], devices)
    count = operations(config, Counter(lane.algo for lane in lanes))
    said = f"{len(lanes)} lanes x {config.steps:,} steps; memory {cost}"
    if len(parts) > 1:
        said += f", in {len(parts)} waves of {len(parts[0])} lanes"
    if count:
        said += f"; learning at least {count:.1e} operations, {_duration(count / 1e11)} at 100 GFLOP/s"
    return said + "."


def _duration(seconds: float) -> str:
    for unit, name in ((365.25 * 86_400, "years"), (86_400, "days"), (3_600, "hours"), (60, "minutes")):
        if seconds >= 2 * unit:
            return f"{seconds / unit:.0f} {name}"
    return f"{seconds:.0f} seconds"
