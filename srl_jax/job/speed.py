"""How fast this machine is at what a run is made of: physics and products of matrices."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import rollout

from srl_jax.env.model import load_model, put_model, stance
from srl_jax.env.physics import choose, time_step

SIZE = 2_048  # of the square matrices
ROBOTS = 256  # that one core steps at once


def best(action: Callable[[], Any], repeats: int) -> float:
    """Seconds of the fastest of several calls, after one to warm up: noise only ever slows down."""
    action()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


def sgemm_rate(repeats: int = 3, size: int = SIZE) -> float:
    """Floating-point operations per second of a float32 matrix product on all cores, by XLA as everything else."""
    matrix = jax.random.normal(jax.random.key(0), (size, size))
    product = jax.jit(jnp.matmul)
    return 2.0 * size**3 / best(lambda: product(matrix, matrix).block_until_ready(), repeats)


def physics_rate(repeats: int = 3, robots: int = ROBOTS) -> float:
    """Physics steps per second of one device, by the stepper that a run would take; compiling is not counted."""
    return 10.0 * robots / time_step(choose("auto"), put_model(load_model()), robots, repeats)


def c_mujoco_rate(threads: int, repeats: int = 3) -> float:
    """Physics steps per second of C MuJoCo, so many threads, position targets that wobble about the stance."""
    model, robots, steps = load_model(), 8 * threads, 500
    data = [mujoco.MjData(model) for _ in range(threads)]
    mujoco.mj_resetDataKeyframe(model, data[0], 0)
    first = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data[0], first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    wobble = 0.2 * np.sin(np.arange(steps) / 5.0)[None, :, None]
    control = stance(model)[7:] + wobble * np.ones((robots, 1, model.nu))
    seconds = best(lambda: rollout.rollout(model, data, np.tile(first, (robots, 1)), control), repeats)
    return robots * steps / seconds
