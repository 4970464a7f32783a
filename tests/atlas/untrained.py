"""An atlas of four policies that were never trained, and of four damages."""

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents.networks import Actor
from srl_jax.atlas.file import Atlas
from srl_jax.env import gait as gaits
from srl_jax.env.hexapod import ACTION_SIZE, observation_size
from srl_jax.env.senses import SIZE
from srl_jax.env.settings import EnvConfig

DAMAGES = ("healthy", "leg_rm", "femur_lf:limp", "leg_rf+leg_lr")


def make():
    """Policy i is the best under damage i."""
    network, size = Actor((8, 8), ACTION_SIZE, True), observation_size("x", EnvConfig(observation="onboard"))
    keys = jax.random.split(jax.random.key(0), len(DAMAGES))
    actors = jax.vmap(lambda key: network.init(key, jnp.zeros(size)))(keys)
    about = {"task": "x", "observation": "onboard", "clock_hz": float(gaits.load().frequency)}
    return Atlas(
        damages=DAMAGES,
        trained_for=DAMAGES,
        actors=jax.tree.map(np.asarray, actors),
        speed=np.float32(0.1 + 0.4 * np.eye(len(DAMAGES))),
        falls=np.zeros((len(DAMAGES),) * 2, np.float32),
        whitening=np.eye(SIZE, dtype=np.float32) / np.repeat(np.float32([0.04, 0.4, 0.05]), (18, 3, 3)),
        about=about | {"hidden": [8, 8], "layer_norm": True},
    )
