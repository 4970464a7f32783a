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
    moved = rates(positions[:, :2], window)
    return moved[:, 0] if task == "x" else np.linalg.norm(moved, axis=1)


def rates(come: np.ndarray, window: int = WINDOW) -> np.ndarray:
    """m/s f64[T, ...] over the `window` control steps that end with each step, of m come f64[T, ...], at first none."""
    path = np.concatenate([np.zeros((window, *come.shape[1:])), come])
    return (path[window:] - path[:-window]) * CONTROL_HZ / window
