"""What several tests share: a batch, posterior draws by explicit loops, and a critic whose opinion is known."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.types import Params, Transition

OBSERVATION, ACTION, BATCH = 4, 2, 6


def batch_of(seed: int = 0, **changed) -> Transition:
    """Random transitions, two of which end their episode."""
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.normal(size=(BATCH, *shape)).astype("f")  # noqa: E731
    return Transition(
        observation=draw(OBSERVATION),
        action=np.clip(draw(ACTION), -1, 1),
        reward=draw(),
        discount=np.array([1, 1, 0, 1, 0, 1], "f"),
        next_observation=draw(OBSERVATION),
        chosen=np.zeros(BATCH, "f"),
        lot=rng.integers(0, 2**24, BATCH).astype("f"),
    )._replace(**changed)


def assert_same_movement(before: Params, after: Params, expected: Params, tolerance: float) -> None:
    """Fails where a movement differs from the expected one by more than a fraction of that one's length.

    Parameters after a step differ from those before by a few thousandths, so a comparison of parameters proves little.
    """
    flat = lambda tree: np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(tree)])  # noqa: E731
    moved, wanted = flat(after) - flat(before), flat(expected) - flat(before)
    length = np.linalg.norm(wanted)
    assert length > 0.0, "nothing was to move"
    assert np.linalg.norm(moved - wanted) <= tolerance * length, np.linalg.norm(moved - wanted) / length


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
