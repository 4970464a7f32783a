"""What the tests of the star stepper share: states, and paths of `mjx.step` beside the stepper's own."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from srl_jax.env import physics
from srl_jax.env.damage import Damage
from srl_jax.env.model import mjx, put_model
from srl_jax.env.star import batching
from srl_jax.env.star.constants import read
from srl_jax.env.star.stepper import State

STEPS = 60


class Paths(NamedTuple):
    """States [T, N, ...] after each step."""

    expected: State  # by `mjx.step`
    single: State  # by one step of the stepper from where `mjx.step` was before
    free: State  # by the stepper alone, from the same start


def leaves(models: Sequence[mujoco.MjModel], spread: float = 0.0) -> Damage:
    """The leaves that damage changes f[N, ...], of a model for each robot; all varied by parts up to `spread`."""
    rng = np.random.default_rng(1)
    found = [np.stack([getattr(model, field) for model in models]) for field in Damage._fields]
    varied = [x * (1 + spread * rng.uniform(-1, 1, x.shape)) for x in found]
    return Damage(*varied)._replace(qpos_spring=found[Damage._fields.index("qpos_spring")])


def states(model: mujoco.MjModel, robots: int, seed: int = 0) -> tuple[State, np.ndarray]:
    """Robots that stand, walk, fall and lie on their back, a quarter each, and targets that swing f[STEPS, N, nu].

    Quaternions are not all of length 1; joints are out of their limits now and then. All numbers are f32's.
    """
    rng = np.random.default_rng(seed)
    kind = np.arange(robots) % 4
    wild = lambda *by_kind: np.array(by_kind)[kind, None]  # noqa: E731
    qpos = np.tile(model.key("stance").qpos, (robots, 1))
    qpos[:, 7:] += wild(0.05, 0.3, 0.6, 1.0) * rng.normal(size=qpos[:, 7:].shape)
    qpos[:, 2] += np.where(kind == 2, rng.uniform(0, 0.3, robots), 0.01 * rng.normal(size=robots))
    qpos[kind == 3, 2] = 0.05
    turns = wild(0.02, 0.1, 0.5, 0.3) * rng.normal(size=(robots, 3)) + wild(0, 0, 0, np.pi) * (1, 0, 0)
    for row, turn in zip(qpos, turns, strict=True):
        mujoco.mju_axisAngle2Quat(row[3:7], turn / np.linalg.norm(turn), float(np.linalg.norm(turn)))
    qpos[1::3, 3:7] *= 1.01
    qvel = wild(0.1, 0.7, 0.7, 1.5) * rng.normal(size=(robots, model.nv))
    warm = wild(0.3, 3, 3, 6) * rng.normal(size=(robots, model.nv))
    joints = qpos[:, model.jnt_qposadr[model.actuator_trnid[:, 0]]] + 0.4 * rng.normal(size=(robots, model.nu))
    swing = 0.3 * np.sin(0.3 * np.arange(STEPS)[:, None, None] + np.arange(robots)[:, None])
    rounded = lambda x: x.astype(np.float32).astype(np.float64)  # noqa: E731
    return State(*map(rounded, (qpos, qvel, warm))), rounded(joints + swing)


def both(c_model: mujoco.MjModel) -> Callable[[Damage, State, np.ndarray], Paths]:
    """A compiled function of leaves [N, ...], start [N, ...] and targets [T, N, nu]."""
    model, data = put_model(c_model), mjx.make_data(c_model)
    star = read(model)
    own = jax.vmap(lambda values, state, control: batching.simulate(star, values, control, state, 1))
    theirs = jax.vmap(lambda values, state, control: physics.simulate_mjx(model, data, values, state, control, 1))
    joined = lambda x, y: jax.tree.map(lambda u, v: jnp.concatenate([u, v]), x, y)  # noqa: E731

    def paths(values: Damage, start: State, targets: jax.Array) -> Paths:
        def once(carry: tuple[State, State], control: jax.Array):
            after = theirs(values, carry[0], control)
            reached = own(joined(values, values), joined(*carry), joined(control, control))
            single, free = (jax.tree.map(lambda x, i=i: jnp.split(x, 2)[i], reached) for i in (0, 1))
            return (after, free), Paths(after, single, free)

        return jax.lax.scan(once, (start, start), targets)[1]

    return jax.jit(paths)


class Trial(NamedTuple):
    """What was stepped, and how it went."""

    robots: list[mujoco.MjData]  # N, some of which may be the same
    start: State
    targets: np.ndarray
    values: Damage
    paths: Paths

    def before(self, step: int) -> State:
        """Where `mjx.step` was before a step."""
        return self.start if step == 0 else jax.tree.map(lambda x: x[step - 1], self.paths.expected)


def attempt(robots: list[mujoco.MjData], spread: float = 0.0) -> Trial:
    """Robots of one structure, stepped in f64 `STEPS` times."""
    models = [data.model for data in robots]
    start, targets = states(models[0], len(models))
    values = leaves(models, spread)
    with jax.enable_x64(True):
        found = jax.device_get(both(models[0])(values, start, targets))
    assert found.expected.qpos.dtype == np.float64
    return Trial(robots, start, targets, values, found)


def in_c(robots: Sequence[mujoco.MjData], start: State, targets: np.ndarray) -> State:
    """One step of C MuJoCo of every robot, from `start` [N, ...] under targets f[N, nu]; they may share data."""
    reached = []
    for data, qpos, qvel, warm, control in zip(robots, *start, targets, strict=True):
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:], data.ctrl[:] = qpos, qvel, warm, control
        mujoco.mj_step(data.model, data)
        reached.append((data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy()))
    return State(*map(np.stack, zip(*reached, strict=True)))


def largest(x: State, y: State) -> State:
    """The largest difference of each robot, [...] without the last axis."""
    return State(*(np.abs(u - v).max(-1) for u, v in zip(x, y, strict=True)))
