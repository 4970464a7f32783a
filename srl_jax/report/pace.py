"""How fast a robot was, over the second that ends with each control step."""

import numpy as np

from srl_jax.env.hexapod import CONTROL_HZ

WINDOW = 20  # control steps


def speeds(positions: np.ndarray, task: str = "x", window: int = WINDOW) -> np.ndarray:
    """m/s f64[T] over the `window` control steps that end with each step; before the first it stood at the origin.

    Args:
        positions: f64[T, ...] whose first two columns are x and y, m.
        task: x: along x; otherwise over ground.
        window: control steps.
    """
    path = np.concatenate([np.zeros((window, 2)), positions[:, :2]])
    come = path[window:] - path[:-window]
    return (come[:, 0] if task == "x" else np.linalg.norm(come, axis=1)) * CONTROL_HZ / window
