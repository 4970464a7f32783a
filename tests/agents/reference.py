"""What several tests of SRL compare with: posterior draws by explicit loops, and a critic whose opinion is known."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.types import Params


def loop_draws(critic: Callable, params: Params, observation, actions, masks) -> np.ndarray:
    """Q for one state under every mask and member: f32[J * K, N]."""
    params, masks = jax.tree.map(np.asarray, (params, masks))
    members, draws = masks[0].shape[:2]
    one = [jax.tree.map(lambda x, k=k: x[k], params) for k in range(members)]
    return np.array(
        [
            [critic(one[k], observation, np.asarray(action), tuple(m[k, j] for m in masks)) for action in actions]
            for j in range(draws)
            for k in range(members)
        ]
    )


def convinced_critic(critic: Params, slope: float, observation_size: int) -> Params:
    """Members that all believe ``Q(s, a) = slope (4 + sum(a))``, on one unit per layer and no dropout."""

    def place(path, leaf):
        name = jax.tree_util.keystr(path)
        zero = jnp.zeros_like(leaf)
        if "Torso_0" in name and "Dense_0" in name:
            return zero.at[:, 0].set(4.0) if "bias" in name else zero.at[:, observation_size:, 0].set(1.0)
        if "Dense_1" in name:
            return zero if "bias" in name else zero.at[:, 0, 0].set(1.0)
        return zero if "bias" in name else zero.at[:, 0, 0].set(slope)

    return jax.tree_util.tree_map_with_path(place, critic)
