"""What a run has learned, as policies that need neither the run nor jax."""

from pathlib import Path

from srl_jax import machine
from srl_jax.agents.settings import ActorConfig
from srl_jax.env import damage_names
from srl_jax.env.interface import facts
from srl_jax.job import command
from srl_jax.job.students import Run, open_run
from srl_jax.portable import Policy, pick
from srl_jax.portable.policy import layers
from srl_jax.program.lanes import Lane


def from_run(
    directory: Path, *, seed: int | None = None, algos: tuple[str, ...] = (), damages: tuple[str, ...] = ()
) -> list[Policy]:
    """The students of a finished run whose actors are networks.

    Args:
        directory: of the run.
        seed: only lanes of this seed; None: all.
        algos: only these algorithms; none: all that learn a network.
        damages: only what was learned for these; none: all.

    Raises:
        ValueError: the run is not finished, lacks an algorithm, the seed or a damage, or learns no network.
    """
    run = open_run(directory)
    damages = tuple(damage_names.canonical(damage, run.robot.anatomy) for damage in damages)
    learned = tuple(algo for algo in run.algos if isinstance(run.config.agent(algo), ActorConfig))
    for algo in algos:
        if algo in run.algos and algo not in learned:
            raise ValueError(f"algo is {algo!r}, which learns no network: export {', '.join(learned) or 'none'}.")
    lanes = [lane for algo in algos or learned for lane in run.lanes_of(algo)]
    if not lanes:
        raise ValueError(f"{directory} has no policy that is a network: its algorithms are {', '.join(run.algos)}.")
    chosen = [lane for lane in lanes if seed is None or lane.seed == seed]
    if not chosen:
        raise ValueError(
            f"seed is {seed}: {directory} has {', '.join(str(s) for s in sorted({x.seed for x in lanes}))}."
        )
    return pick([_student(run, lane) for lane in chosen], damages, str(directory))


def _student(run: Run, lane: Lane) -> Policy:
    env = run.config.env
    damage = lane.damage if run.config.damage_mix else run.damage(lane)
    made = {"algo": lane.algo, "method": lane.method, "damage": damage, "seed": lane.seed}
    needed = facts(run.config.task, env.observation, run.robot.clock_hz, env.history, run.robot.anatomy)
    origin = {"steps": run.config.steps, "command": command.again(run.config), "versions": machine.versions()}
    about = made | needed | origin
    return Policy(layers(run.learned(lane)["actor"]), about)
