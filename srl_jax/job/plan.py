"""What a configuration asks for, checked before anything is allocated: lanes, stages of damage, memory."""

from dataclasses import dataclass

from srl_jax.agents.networks import network_sizes
from srl_jax.agents.settings import ActorConfig, DDPGConfig, ITEConfig, SearchConfig
from srl_jax.config import ALGORITHMS, Config
from srl_jax.env import damage_names
from srl_jax.env.hexapod import ACTION_SIZE, observation_size
from srl_jax.program import lanes as lane_table
from srl_jax.program.lanes import Lane
from srl_jax.program.replay import width


@dataclass(frozen=True)
class Plan:
    """The lanes of a run and, for each, which damage is in force from which step on."""

    lanes: list[Lane]
    stages: tuple[tuple[int, str | None], ...]  # (from step, damage of all lanes; None: the lane's own)

    def damage(self, lane: Lane, step: int) -> str:
        """The damage of a lane at an environment step."""
        name = next(name for start, name in reversed(self.stages) if start <= step)
        return lane.damage if name is None else name


def make(config: Config) -> Plan:
    """The lanes and stages of a configuration.

    Raises:
        ValueError: a field has an unknown or impossible value; the message names it and what is accepted.
    """
    check_numbers(config)
    algos, seeds = parse_algos(config.algos), parse_seeds(config.seeds)
    if config.damage_schedule:
        stages: tuple[tuple[int, str | None], ...] = parse_schedule(config)
        names: tuple[str, ...] = (">".join(f"{name}@{start}" for start, name in stages),)
    else:
        stages, names = ((0, None),), damage_names.parse_names(config.damage, config.task)
    return Plan(lane_table.table(config, seeds, algos, names), stages)


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
    unknown = [algo for algo in algos if algo not in ALGORITHMS]
    if unknown or len(set(algos)) < len(algos):
        raise ValueError(f"algos is {text!r}: choose from {', '.join(ALGORITHMS)}, each at most once.")
    return algos


def parse_schedule(config: Config) -> tuple[tuple[int, str | None], ...]:
    """`name@step,...` as (step, canonical name) in order of steps."""
    stages, every = [], config.train.environments
    for part in config.damage_schedule.split(","):
        name, _, step = part.strip().partition("@")
        if not step.isdigit():
            raise ValueError(f"damage_schedule has {part!r}: write name@step, such as tibia_rm@20000.")
        stages.append((int(step), damage_names.canonical(name)))
    starts = [start for start, _ in stages]
    if starts[0] != 0 or starts != sorted(set(starts)) or starts[-1] >= config.steps:
        raise ValueError(f"damage_schedule starts at {starts}: begin at 0, rise, and end below steps={config.steps}.")
    if any(start % every for start in starts):
        raise ValueError(f"damage_schedule starts at {starts}: use multiples of train.environments={every}.")
    return tuple(stages)


def check_numbers(config: Config) -> None:
    """Raises ValueError for numbers that do not fit each other."""
    train, env = config.train, config.env
    positive = {
        "train.environments": train.environments,
        "steps": config.steps,
        "env.episode_steps": env.episode_steps,
    }
    positive |= {"train.evaluate_every": train.evaluate_every, "train.update_every": train.update_every}
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
    low, high = env.goal_ring
    if not env.goal_radius < low <= high:
        raise ValueError(
            f"env.goal_ring is {env.goal_ring}: it must rise and lie beyond env.goal_radius={env.goal_radius}."
        )
    for algo in parse_algos(config.algos):
        agent = getattr(config, algo)
        if isinstance(agent, ActorConfig):
            check_actor(algo, agent)
        if isinstance(agent, SearchConfig):
            check_search(algo, agent, config.behaviour)
        if isinstance(agent, ITEConfig):
            check_trials(algo, agent, config.task)


KERNEL = ("kernel_length", "value_scale", "advantage_scale", "reward_noise")
RANGES = {
    "gamma": (0.0, 1.0),
    "tau": (0.0, 1.0),
    "noise_correlation": (0.0, 0.999),
    "dropout": (0.0, 0.99),
    "beta": (0.0, 1.0),
    "psi": (0.0, 1.0),
    "prior_fraction": (0.0, 1.0),
    "bootstrap": (0.0, 1.0),
    "noise_decay": (0.0, 1.0),
}


def check_search(algo: str, config: SearchConfig, behaviour: str) -> None:
    """Raises ValueError for settings of an episodic search that make no sense."""
    if behaviour.split(",")[0] != "gait":
        raise ValueError(f"behaviour is {behaviour!r}: {algo} searches a gait's parameters and needs gait, first.")
    if config.trajectories < 2:
        raise ValueError(f"{algo}.trajectories is {config.trajectories}: it must be at least 2.")
    for name in ("search_rate", "spread", "spread_floor", "return_noise"):
        if any(value <= 0.0 for value in getattr(config, name)):
            raise ValueError(f"{algo}.{name} is {getattr(config, name)}: it must be positive.")


def check_trials(algo: str, config: ITEConfig, task: str) -> None:
    """Raises ValueError for settings of intelligent trial and error that make no sense."""
    if task == "p2p":
        raise ValueError(f"algos has {algo}: its gaits walk straight ahead; use it with task x or xy, not {task}.")
    if config.trials < 1:
        raise ValueError(f"{algo}.trials is {config.trials}: it must be at least 1.")
    for name in ("rho", "prior", "trial_noise", "kappa", "sufficient"):
        if any(value <= 0.0 for value in getattr(config, name)):
            raise ValueError(f"{algo}.{name} is {getattr(config, name)}: it must be positive.")


def check_actor(algo: str, config: ActorConfig) -> None:
    """Raises ValueError for settings of an agent with networks that make no sense."""
    if not config.hidden or min(config.hidden) < 1 or config.batch < 1:
        raise ValueError(f"{algo}.hidden and batch must be positive: {config.hidden}, {config.batch}.")
    if isinstance(config, DDPGConfig):
        check_ensemble(algo, config)
    for name, (low, high) in RANGES.items():
        for value in getattr(config, name, ()):
            if not low <= value <= high:
                raise ValueError(f"{algo}.{name} is {value:g}: it must lie between {low:g} and {high:g}.")
    for name in (
        "actor_lr",
        "critic_lr",
        "noise",
        "freeze",
        "guidance_weight",
        "weight_decay",
    ):
        if any(value < 0.0 for value in getattr(config, name, ())):
            raise ValueError(f"{algo}.{name} is {getattr(config, name)}: it must not be negative.")
    for name in ("prior_decay", "guidance_decay", *KERNEL):
        if any(value <= 0.0 for value in getattr(config, name, ())):
            raise ValueError(f"{algo}.{name} is {getattr(config, name)}: it must be positive.")


def check_ensemble(algo: str, config: DDPGConfig) -> None:
    """Raises ValueError for a critic ensemble, or posterior draws of it, that cannot be."""
    for name, value in (("critics", config.critics), ("critic_updates", config.critic_updates)):
        if value < 1:
            raise ValueError(f"{algo}.{name} is {value}: it must be at least 1.")
    for name in ("draws", "guidance_draws"):
        draws = getattr(config, name, config.critics)
        if draws < 1 or draws % config.critics:
            raise ValueError(f"{algo}.{name} is {draws}: it must be a positive multiple of critics={config.critics}.")


def capacity(config: Config) -> int:
    """Transitions that a lane remembers: those of one step where no algorithm of the run replays any."""
    replays = any(isinstance(getattr(config, algo), ActorConfig) for algo in parse_algos(config.algos))
    return config.train.capacity if replays else config.train.environments


def memory_bytes(config: Config, rows: int) -> dict[str, int]:
    """Bytes that a run allocates, by purpose: arithmetic only.

    The replay dominates: rows x capacity x (2 O + 18 + 3) x 4 bytes, and again while a checkpoint is being written.
    """
    size = observation_size(config.task, config.env)
    replay = rows * capacity(config) * width(size, ACTION_SIZE) * 4
    checkpoint = rows * min(capacity(config), config.steps) * width(size, ACTION_SIZE) * 4
    agents = [getattr(config, algo) for algo in parse_algos(config.algos)]
    per_algo = [network_sizes(agent, size, ACTION_SIZE) for agent in agents if isinstance(agent, ActorConfig)]
    networks = rows * max((4 * actor + 4 * critic for actor, critic in per_algo), default=0) * 4
    return {"replay": replay, "checkpoint copy": checkpoint, "networks": networks, "program": 2**30}


def check_memory(config: Config, rows: int) -> str:
    """The arithmetic as one line.

    Raises:
        ValueError: it exceeds `memory_gb`.
    """
    parts = memory_bytes(config, rows)
    total = sum(parts.values()) / 2**30
    size = observation_size(config.task, config.env)
    line = (
        f"{rows} rows x {capacity(config)} transitions x {width(size, ACTION_SIZE)} floats x 4 bytes = "
        + " + ".join(f"{value / 2**30:.2f} GiB {name}" for name, value in parts.items())
    )
    if total > config.memory_gb:
        raise ValueError(
            f"memory_gb is {config.memory_gb:g}, but the run needs {total:.2f} GiB ({line}); "
            "raise it, or lower train.capacity or the number of lanes."
        )
    return line + f" = {total:.2f} GiB"
