"""How the story of a recovery is told in a terminal, line by line as it happens."""

import random

import numpy as np

from srl_jax.atlas import file, recovery
from srl_jax.atlas.mind import Memory
from srl_jax.atlas.robots import CRobot, World
from srl_jax.atlas.twins import ROOM, Composer
from srl_jax.env import damage_names
from srl_jax.env.hexapod import CONTROL_HZ

EVERY = 4  # control steps between two lines
WINDOW = 20  # control steps over which a speed is shown


def tell(*, atlas: str, damage: str, strike: float, seconds: float, rule: str, friction: float, seed: int) -> None:
    """Runs one robot, and prints what it thinks five times a second; the arguments are those of the verb.

    Raises:
        ValueError: the atlas cannot be read, or the damage has no meaning.
    """
    known = file.load(atlas)
    if damage == "random":
        damage = random.Random(seed).choice(known.damages[1:])
    damage = damage_names.canonical(damage)
    struck = round(strike * CONTROL_HZ)
    robot = CRobot(damage, struck, seed, World(friction=friction))
    foreseen = "is in the atlas" if damage in known.damages else "was never foreseen"
    print(f"{damage} strikes after {strike:g} s; it {foreseen}.")
    print(f"{'s':>5} {'m/s':>5}  {'walks by the policy for':<24} {'what it holds likely'}")

    def watch(memory: Memory, composer: Composer) -> None:
        step = len(robot.positions)
        put_together = [f"{name} (put together)" for name in composer.added[0]]
        names = [*known.damages, *put_together, *[""] * (ROOM - len(put_together)), "none of these"]
        if step % EVERY == 0:
            belief = np.exp(np.asarray(memory.belief.log[0]))
            likely = ", ".join(f"{names[i]} {belief[i]:.2f}" for i in np.argsort(-belief)[:3] if belief[i] >= 0.005)
            walkers = [*known.trained_for, *(f"{name} (learned)" for name in composer.added[0])]
            policy = walkers[int(memory.choice.policy[0])]
            mark = "*" if step == struck else " "
            print(f"{step / CONTROL_HZ:5.1f}{mark}{speed(robot, step):5.2f}  {policy:<24} {likely}", flush=True)

    own = recovery.scope(known, rule=rule)
    recovery.run(known, [robot], seconds=seconds, scopes=lambda _: [own], seed=seed, watch=watch)
    end = len(robot.positions)
    before, after = speed(robot, struck), speed(robot, end, window=min(100, end - struck))
    fell = ", and it fell" if robot.fell else ""
    print(f"Before {before:.2f} m/s, in the last {min(100, end - struck) / CONTROL_HZ:g} s {after:.2f} m/s{fell}.")


def speed(robot: CRobot, step: int, window: int = WINDOW) -> float:
    """m/s along x over the control steps before `step`."""
    first = max(step - window, 0)
    if step - first < 2:
        return 0.0
    return float(robot.positions[step - 1][0] - robot.positions[first][0]) * CONTROL_HZ / (step - 1 - first)
