"""What a configuration asks for, checked before anything is allocated: lanes, and stages of damage.

This module imports no jax, so that lanes can be counted before devices are set up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from srl_jax.agents import registry
from srl_jax.agents.sweep import variants
from srl_jax.config import Config
from srl_jax.env import damage_names
from srl_jax.env.settings import TASKS
from srl_jax.program.lanes import MIX, Lane


@dataclass(frozen=True)
class Plan:
    """The lanes of a run and, for each, which damage is in force from which step on."""

    lanes: Sequence[Lane]
    stages: tuple[tuple[int, str | None], ...]  # (from step, damage of all lanes; None: the lane's own)
    room: Mapping[str, int] = field(default_factory=dict)  # rows of an algorithm, at least: parts are alike in shape

    def damage(self, lane: Lane, step: int) -> str:
        """The damage of a lane at an environment step."""
        name = next(name for start, name in reversed(self.stages) if start <= step)
        return lane.damage if name is None else name

    def damages(self, lanes: Sequence[Lane], step: int) -> list[str]:
        """The damage of each lane at an environment step."""
        return [self.damage(lane, step) for lane in lanes]


def make(config: Config) -> Plan:
    """The lanes and stages of a configuration.

    Raises:
        ValueError: a field has an unknown or impossible value; the message names it and what is accepted.
    """
    check(config)
    algos, seeds, names = parse_algos(config.algos), parse_seeds(config.seeds), parse_damages(config)
    stages = parse_schedule(config) if config.damage_schedule else ((0, None),)
    number, parts = parse_part(config.part)
    first, own, room = 0, [], {}
    for algo, count in counts(config).items():
        if count < parts:
            raise ValueError(f"part is {config.part!r}: {algo} has {count} lanes; make at most as many parts.")
        own += range(first + number * count // parts, first + (number + 1) * count // parts)
        room[algo] = -(-count // parts)
        first += count
    return Plan(table(config, seeds, algos, names, own), stages, room)


def counts(config: Config) -> dict[str, int]:
    """How many lanes each algorithm has in all parts together; none is made.

    Raises:
        ValueError: algorithms, seeds or damages are none.
    """
    each = len(parse_damages(config)) * len(parse_seeds(config.seeds))
    return {algo: sum(1 for _ in variants(config.agent(algo))) * each for algo in parse_algos(config.algos)}


def table(
    config: Config,
    seeds: Sequence[int],
    algos: Sequence[str],
    damages: Sequence[str],
    only: Sequence[int] | None = None,
) -> list[Lane]:
    """Every lane of a run, numbered: algorithms, their variants, damages, seeds.

    Args:
        config: of the run.
        seeds: of the run.
        algos: in order.
        damages: canonical names.
        only: numbers of the lanes that are wanted; the others of a large sweep are never made.
    """
    options = [(algo, tuple(variant.items())) for algo in algos for variant in variants(config.agent(algo))]
    every = range(len(options) * len(damages) * len(seeds))
    lanes = []
    for index in every if only is None else only:
        place, seed = divmod(index, len(seeds))
        option, damage = divmod(place, len(damages))
        algo, variant = options[option]
        lanes.append(Lane(index, algo, seeds[seed], config.task, damages[damage], variant))
    return lanes


def parse_damages(config: Config) -> tuple[str, ...]:
    """The damages that lanes differ by; a schedule is one, and so is a mix."""
    if config.damage_mix:
        return (MIX,)
    if config.damage_schedule:
        return (">".join(f"{name}@{start}" for start, name in parse_schedule(config)),)
    return damage_names.parse_names(config.damage, config.task, config.anatomy)


def parse_mix(config: Config) -> tuple[str, ...]:
    """The damages that the robots of every lane draw from; none where each lane has one damage."""
    if not config.damage_mix:
        return ()
    return damage_names.parse_names(config.damage_mix, config.task, config.anatomy)


def parse_part(text: str) -> tuple[int, int]:
    """`k/n`, k from 1 to n, as (k - 1, n); empty: the only part of one."""
    number, slash, parts = (text or "1/1").partition("/")
    if not (slash and number.isdecimal() and parts.isdecimal() and 1 <= int(number) <= int(parts)):
        raise ValueError(f"part is {text!r}: give k/n with k from 1 to n, such as 3/16.")
    return int(number) - 1, int(parts)


def parse_seeds(text: str) -> tuple[int, ...]:
    """A count (`10`: 0..9) or a list (`3,7,11`; `3,` for seed 3 alone)."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts or not all(part.isdigit() for part in parts):
        raise ValueError(f"seeds is {text!r}: give a count such as 10 or a list such as 3,7,11.")
    seeds = tuple(map(int, parts)) if "," in text else tuple(range(int(parts[0])))
    if not seeds or len(set(seeds)) < len(seeds) or max(seeds) >= 2**31:
        raise ValueError(f"seeds is {text!r}: give at least one seed below 2147483648, none of them twice.")
    return seeds


def parse_algos(text: str) -> tuple[str, ...]:
    """Names of algorithms, separated by commas."""
    algos = tuple(part.strip() for part in text.split(","))
    unknown = [algo for algo in algos if algo not in registry.names()]
    if unknown or len(set(algos)) < len(algos):
        raise ValueError(f"algos is {text!r}: choose from {', '.join(registry.names())}, each at most once.")
    return algos


def parse_teachers(config: Config) -> list[str]:
    """The teachers that a configuration asks for, in order; the first is pi_B."""
    return [name.strip() for name in config.behaviour.split(",")]


def parse_schedule(config: Config) -> tuple[tuple[int, str | None], ...]:
    """`name@step,...` as (step, canonical name) in order of steps."""
    stages, every = [], config.train.environments
    for part in config.damage_schedule.split(","):
        name, _, step = part.strip().partition("@")
        if not step.isdigit():
            raise ValueError(f"damage_schedule has {part!r}: write name@step, such as tibia_rm@20000.")
        stages.append((int(step), damage_names.canonical(name, config.anatomy)))
    starts = [start for start, _ in stages]
    if starts[0] != 0 or starts != sorted(set(starts)) or starts[-1] >= config.steps:
        raise ValueError(f"damage_schedule starts at {starts}: begin at 0, rise, and end below steps={config.steps}.")
    if any(start % every for start in starts):
        raise ValueError(f"damage_schedule starts at {starts}: use multiples of train.environments={every}.")
    return tuple(stages)


def check(config: Config) -> None:
    """Raises ValueError for values that are out of range or do not fit each other."""
    if config.task not in TASKS:
        raise ValueError(f"task is {config.task!r}: choose from {', '.join(TASKS)}.")
    check_numbers(config)
    if parse_mix(config) and config.damage_schedule:
        raise ValueError(f"damage_mix is {config.damage_mix!r}: it does not go with damage_schedule; leave one out.")
    for algo in parse_algos(config.algos):
        check_algorithm(algo, config)


def check_numbers(config: Config) -> None:
    """Raises ValueError for numbers of the run that do not fit each other."""
    train = config.train
    config.env.check()
    positive = {
        "train.environments": train.environments,
        "steps": config.steps,
        "evaluation.episodes": config.evaluation.episodes,
        "train.evaluate_every": train.evaluate_every,
        "train.update_every": train.update_every,
        "train.updates": train.updates,
    }
    for name, value in positive.items():
        if value < 1:
            raise ValueError(f"{name} is {value}: it must be at least 1.")
    multiples = {
        "train.capacity": (train.capacity, "train.environments", train.environments),
        "train.prior_steps": (train.prior_steps, "train.environments", train.environments),
        "train.evaluate_every": (train.evaluate_every, "train.environments", train.environments),
        "train.checkpoint_every": (train.checkpoint_every, "train.evaluate_every", train.evaluate_every),
        "steps": (config.steps, "train.evaluate_every", train.evaluate_every),
    }
    for name, (value, of, unit) in multiples.items():
        if value < unit or value % unit:
            raise ValueError(f"{name} is {value}: it must be a positive multiple of {of}={unit}.")
    if train.capacity < train.prior_steps:
        raise ValueError(f"train.capacity is {train.capacity}: it must hold train.prior_steps={train.prior_steps}.")


def check_algorithm(algo: str, config: Config) -> None:
    """Raises ValueError for settings of an algorithm that make no sense, or a run that lacks what it needs."""
    agent = config.agent(algo)
    agent.check(algo)
    if agent.tasks is not None and config.task not in agent.tasks:
        raise ValueError(f"task is {config.task!r}: {algo} does {' and '.join(agent.tasks)} only.")
    if agent.episode_steps not in (None, config.env.episode_steps):
        raise ValueError(
            f"env.episode_steps is {config.env.episode_steps}: {algo} compares its episodes with walks of "
            f"{agent.episode_steps} steps and needs as many."
        )
    if agent.one_damage and config.damage_mix:
        raise ValueError(
            f"damage_mix is {config.damage_mix!r}: {algo} finds out about one damage, which all robots of a lane must "
            "have; use damage instead."
        )
    if agent.first_teacher not in (None, parse_teachers(config)[0]):
        raise ValueError(f"behaviour is {config.behaviour!r}: {algo} needs {agent.first_teacher}, first.")
