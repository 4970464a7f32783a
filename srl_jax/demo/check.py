"""Whether a policy walks for fifteen seconds after a cut in mid-walk: what the page is about to show, in C MuJoCo."""

from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ, SUBSTEPS, UPRIGHT
from srl_jax.env.model import stance
from srl_jax.env.settings import EnvConfig

HEALTHY, UNAWARE, STAND, AFTER, LAST = 60, 10, 20, 300, 100  # control steps; speed is that of the last
GOAL = 1.7  # m to a goal of p2p, the next a golden angle further on
GOLDEN = 2.4  # rad
OUTWARDS = np.array([0.1, 0.0])  # so that the direction of xy is defined at the start
Act = Callable[[np.ndarray], np.ndarray]  # observation -> action


class Walked(NamedTuple):
    """How a policy went on after the cut."""

    speed: float  # m/s in the last five of fifteen seconds: along the heading, or over ground
    fell: bool


class Walker:
    """The robot as the page has it: the model's own physics, exact senses, one control step at a time."""

    def __init__(self, damage: str, task: str, kind: str, clock_hz: float):
        self.models = [damages.damaged_model(name) for name in ("healthy", damage)]
        self.present = [np.asarray(damages.present(damages.build(name))) for name in ("healthy", damage)]
        self.data, self.stance = mujoco.MjData(self.models[0]), stance(self.models[0])
        mujoco.mj_resetDataKeyframe(self.models[0], self.data, 0)
        mujoco.mj_forward(self.models[0], self.data)
        self.task, self.kind, self.tick = task, kind, clock_hz / CONTROL_HZ
        self.phase, self.broken, self.fell = 0.0, 0, False
        self.heading, self.goal, self.turned = np.array([1.0, 0.0]), np.array([GOAL, 0.0]), 0.0
        self.path: list[np.ndarray] = []

    @property
    def frame(self) -> np.ndarray:
        """Rotation from body to world, f64[3, 3]."""
        flat = np.empty(9)
        mujoco.mju_quat2Mat(flat, self.data.qpos[3:7])
        return flat.reshape(3, 3)

    @property
    def ahead(self) -> np.ndarray:
        """Where it looks, a unit vector f64[2] in the world."""
        return self.frame[:2, 0] / max(float(np.linalg.norm(self.frame[:2, 0])), 1e-6)

    def step(self, act: Act | None) -> None:
        """One control step by a policy; None: it stands."""
        action = act(self.observe()) if act else np.zeros(18)
        self.data.ctrl[:] = self.stance[7:] + np.tile(ACTION_SCALE, 6) * action
        mujoco.mj_step(self.models[self.broken], self.data, nstep=SUBSTEPS)
        self.phase = (self.phase + self.tick) % 1.0
        self.fell |= bool(self.frame[2, 2] < UPRIGHT)
        self.path.append(self.data.qpos[:2].copy())
        if self.task == "p2p" and np.linalg.norm(self.goal - self.path[-1]) < EnvConfig().goal_radius:
            self.turned += GOLDEN
            self.goal = self.path[-1] + GOAL * np.array([np.cos(self.turned), np.sin(self.turned)])

    def observe(self) -> np.ndarray:
        """See `senses.observation`; nothing is noisy."""
        data, frame, angle = self.data, self.frame, 2.0 * np.pi * self.phase
        wanted = {"x": self.heading, "xy": data.qpos[:2] + OUTWARDS, "p2p": self.goal - data.qpos[:2]}[self.task]
        distance = float(np.linalg.norm(wanted))
        (gx, gy), (hx, hy) = wanted / max(distance, 1e-6), self.ahead
        there = self.present[self.broken]
        seen: list[Any] = [np.sin(angle), np.cos(angle), gx * hx + gy * hy, hx * gy - hy * gx]
        seen += [min(distance, 2.0)] if self.task == "p2p" else []
        seen += [*-frame[2], *np.where(there, data.qpos[7:] - self.stance[7:], 0.0)]
        seen += [*(frame.T @ data.qvel[:3])] if self.kind == "full" else []
        if self.kind != "onboard":
            seen += [*(0.3 * data.qvel[3:6]), *np.where(there, 0.1 * data.qvel[6:], 0.0)]
        return np.array([*seen, *([10.0 * data.qpos[2]] if self.kind == "full" else [])])


def after_cut(walker: Walker, before: Act, after: Act, *, stands: bool) -> Walked:
    """Walks three seconds, loses what it is to lose, goes on for half a second, and then by the policy for it.

    Args:
        walker: fresh.
        before: of the healthy robot.
        after: for its damage.
        stands: whether the robot stands for a second in between, and takes its heading as the one to walk in.
    """
    for t in range(HEALTHY + UNAWARE):
        walker.broken = int(t >= HEALTHY)
        walker.step(before)
    if stands:
        for _ in range(STAND):
            walker.step(None)
        walker.phase, walker.heading = 0.0, walker.ahead
    for _ in range(AFTER):
        walker.step(after)
    way = np.diff(np.array(walker.path[-LAST - 1 :: 20]), axis=0)  # from second to second
    come = way @ walker.heading if walker.task == "x" else np.linalg.norm(way, axis=1)
    return Walked(float(np.mean(come)), walker.fell)
