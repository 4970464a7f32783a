"""How the story of a recovery is told in a terminal, line by line as it happens, and what is left to look at."""

import random
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np

from srl_jax.atlas import file, recovery
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.lessons import Learn, by_srl
from srl_jax.atlas.mind import Memory
from srl_jax.atlas.recovery import Story
from srl_jax.atlas.robots import ROBOTS, CRobot, MjxRobot, World
from srl_jax.atlas.twins import ROOM, Composer
from srl_jax.env import damage_names
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.report import recovery as pictures
from srl_jax.report.pace import WINDOW, rates
from srl_jax.report.recovery import Walker
from srl_jax.types import Params

EVERY = 4  # control steps between two lines
NONE = "none of these"


def tell(
    *,
    atlas: str,
    damage: str,
    strike: float,
    seconds: float,
    rule: str,
    learn: bool,
    physics: str,
    friction: float,
    out: str,
    seed: int,
) -> None:
    """Runs two robots, one of which has no atlas, and prints what the other thinks five times a second.

    The arguments are those of the verb.

    Raises:
        ValueError: the atlas cannot be read, or the damage has no meaning.
    """
    known = file.load(atlas)
    drawn = random.Random(seed).choice(known.damages[1:])
    held_out = [drawn] if damage == "held-out" else []
    damage = damage_names.canonical(drawn if damage in ("random", "held-out") else damage)
    struck = round(strike * CONTROL_HZ)
    task = known.about["task"]
    if physics == "mjx" and task != "x":
        raise ValueError(f"physics is 'mjx': its robot walks straight ahead, and the atlas is for {task}; use c.")
    make = partial(ROBOTS[task], world=World(friction=friction)) if physics == "c" else MjxRobot
    robot, unaware = (make(damage, struck, seed) for _ in range(2))
    foreseen = damage in known.damages and not held_out
    print(
        f"{damage} strikes after {strike:g} s; {'it is in the atlas' if foreseen else 'the atlas knows nothing of it'}."
    )
    print(f"{'s':>5} {'m/s':>5}  {'walks by the policy for':<28} {'what it holds likely'}")

    def watch(memory: Memory, composer: Composer) -> None:
        step = len(robot.positions)
        if step % EVERY == 0:
            belief = np.exp(np.asarray(memory.belief.log[0]))
            names = hypotheses(known, composer.added[0])
            likely = ", ".join(f"{names[i]} {belief[i]:.2f}" for i in np.argsort(-belief)[:3] if belief[i] >= 0.005)
            policy = walkers(known, composer.added[0])[int(memory.choice.policy[0])]
            mark = "*" if step == struck else " "
            print(f"{step / CONTROL_HZ:5.1f}{mark}{speed(robot, step):5.2f}  {policy:<28} {likely}", flush=True)

    healthy = int(np.argmax(known.value[:, 0]))
    scopes = [recovery.scope(known, held_out, rule=rule), recovery.scope(known, told=healthy)]
    lessons = partial(_learn, by_srl(known)) if learn else False
    story = recovery.run(
        known, [robot, unaware], seconds=seconds, scopes=lambda _: scopes, learn=lessons, seed=seed, watch=watch
    )
    end = len(robot.positions)
    last = min(100, end - struck)
    for who, body in (("With the atlas", robot), ("Without", unaware)):
        fell = ", and it fell" if body.fell else ""
        before, after = speed(body, struck), speed(body, end, window=last)
        print(f"{who}: before {before:.2f} m/s, in the last {last / CONTROL_HZ:g} s {after:.2f} m/s{fell}.")
    if out:
        _draw(Path(out), known, story, robot, unaware, damage, struck)


def hypotheses(atlas: Atlas, added: list[str]) -> list[str]:
    """What each place of a belief stands for."""
    own = [f"{name} (put together)" for name in added]
    return [*atlas.damages, *own, *[""] * (ROOM - len(own)), NONE]


def walkers(atlas: Atlas, added: list[str]) -> list[str]:
    """What each policy was trained for."""
    return [*atlas.trained_for, *(f"{name} (learned)" for name in added)]


def speed(robot: CRobot | MjxRobot, step: int, window: int = WINDOW) -> float:
    """m/s along the task over the control steps before `step`."""
    return float(rates(np.array(robot.come[:step]), window)[-1]) if step else 0.0


def _learn(learn: Learn, damage: str, policy: Params, steps: tuple[int, ...]) -> Iterator[Params]:
    print(f"       (learns for {damage} in its simulation, which walks on elsewhere meanwhile)", flush=True)
    began = perf_counter()
    for count, actor in zip(steps, learn(damage, policy, steps), strict=True):
        spent = perf_counter() - began
        print(f"       ({count:,} environment steps after {spent:.1f} s, compiling included)", flush=True)
        yield actor


def _draw(
    out: Path,
    atlas: Atlas,
    story: Story,
    robot: CRobot | MjxRobot,
    unaware: CRobot | MjxRobot,
    damage: str,
    strike: int,
) -> None:
    """Leaves a figure and a video in a directory."""
    out.mkdir(parents=True, exist_ok=True)
    belief, names = np.exp(story.log_belief), hypotheses(atlas, story.twins[0])
    told = walkers(atlas, story.twins[0])
    own = Walker(
        np.array(robot.positions),
        np.array(robot.come),
        [f"policy for {told[i]}" for i in story.policy[:, 0]],
        [names[i] for i in np.argmax(belief[:, 0], axis=1)],
    )
    other = Walker(
        np.array(unaware.positions), np.array(unaware.come), ["knows nothing"] * len(belief), [""] * len(belief)
    )
    pictures.save_figure(out / "recovery.png", own, other, belief[:, 0], names, strike)
    pictures.save_video(out / "recovery.mp4", own, other, damage, strike)
    print(f"Files: {out}  (recovery.png, recovery.mp4)")
