"""A scripted gait on its way ahead, to the left, back and to the right."""

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env import hexapod


def in_every_direction(robot, damage, act):
    """Five seconds each: positions [4, 100, 3] (m), whether it fell [4, 100], and speed that way [4] (m/s)."""

    def walk(goal, key):
        def control(carry, _):
            state, observation = carry
            state, out = hexapod.step(robot, damage, state, act(observation))
            return (state, out.observation), (state.qpos[:3], out.fell)

        state = hexapod.reset(robot, damage, key)[0]._replace(goal=goal)
        return jax.lax.scan(control, (state, hexapod.observe(robot, damage, state)), None, length=100)[1]

    angle = np.array([0.0, np.pi / 2, np.pi, -np.pi / 2])
    far = 100.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path, fell = jax.jit(jax.vmap(walk))(jnp.float32(far), jax.random.split(jax.random.key(5), 4))
    speed = np.sum(np.asarray(path)[:, -1, :2] * far, axis=1) / 100.0 / 5.0
    return np.asarray(path), np.asarray(fell), speed
