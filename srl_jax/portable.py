"""Policies to take home: observation -> action by NumPy alone, in files without pickle. Imports no jax.

A file says what a policy needs to be run elsewhere: its task, what its observation is made of, by what its action is
scaled, the frequency of its clock, and what made it.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from srl_jax import arrays

EPSILON = 1e-6  # of LayerNorm, as flax has it
WEIGHTS = ("kernel", "bias", "scale", "shift")


class Layer(NamedTuple):
    """Dense, and LayerNorm where the network has it; ReLU follows, and tanh the last layer."""

    kernel: np.ndarray  # f32[I, W]
    bias: np.ndarray  # f32[W]
    scale: np.ndarray | None = None  # f32[W] of LayerNorm
    shift: np.ndarray | None = None  # f32[W]


@dataclasses.dataclass(frozen=True)
class Policy:
    """A deterministic policy f32[..., O] -> f32[..., A] in [-1, 1]."""

    layers: tuple[Layer, ...]
    about: dict[str, Any]
    """algo, task, damage and seed; observation (what it is made of, in order), action_scale (rad of each joint about
    the stance at action 1), clock_hz, control_hz; command and versions that made it."""

    @property
    def observation_size(self) -> int:
        """O."""
        return len(self.layers[0].kernel)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """The action in [-1, 1] at an observation, or at many.

        Raises:
            ValueError: the observation has another size.
        """
        x = np.asarray(observation, np.float32)
        if x.shape[-1:] != (self.observation_size,):
            raise ValueError(
                f"observation has shape {x.shape}: this policy reads {self.observation_size} numbers, "
                f"{', '.join(f'{name} ({size})' for name, size in self.about['observation'])}."
            )
        *hidden, last = self.layers
        for layer in hidden:
            x = np.maximum(_normalised(x @ layer.kernel + layer.bias, layer), 0.0)
        return np.tanh(x @ last.kernel + last.bias)


def _normalised(x: np.ndarray, layer: Layer) -> np.ndarray:
    if layer.scale is None or layer.shift is None:
        return x
    mean = x.mean(axis=-1, keepdims=True)
    variance = np.maximum(np.square(x).mean(axis=-1, keepdims=True) - np.square(mean), 0.0)
    return (x - mean) / np.sqrt(variance + EPSILON) * layer.scale + layer.shift


def save(path: Path, policies: Sequence[Policy], *, half: bool = False) -> None:
    """Writes policies as one .npz, all of the file or nothing of it; at half precision if asked."""
    kept = np.float16 if half else np.float32
    named = {
        f"{i}/{j}/{name}": np.asarray(value, kept)
        for i, policy in enumerate(policies)
        for j, layer in enumerate(policy.layers)
        for name, value in zip(WEIGHTS, layer, strict=True)
        if value is not None
    }
    arrays.save(path, about=np.array(json.dumps([policy.about for policy in policies])), **named)


def load(path: str | Path) -> list[Policy]:
    """The policies in a file.

    Raises:
        ValueError: there is no such file, or it holds no policies.
    """
    path = Path(path)
    try:
        found = arrays.load(path)
        each = json.loads(str(found.pop("about")))
        policies = [Policy(_layers(found, i), about) for i, about in enumerate(each)]
        if not policies or not all(policy.layers for policy in policies):
            raise KeyError("layers")
        return policies
    except FileNotFoundError:
        raise ValueError(f"{path} does not exist: make one with python -m srl_jax.export RUN.") from None
    except (*arrays.UNREADABLE, AttributeError, TypeError) as error:
        raise ValueError(f"{path} cannot be read as policies ({type(error).__name__}).") from error


def _layers(found: dict[str, np.ndarray], number: int) -> tuple[Layer, ...]:
    layers: list[Layer] = []
    while f"{number}/{len(layers)}/kernel" in found:
        place = f"{number}/{len(layers)}"
        own = [found.get(f"{place}/{name}") for name in WEIGHTS]
        layers.append(Layer(*(value if value is None else value.astype(np.float32) for value in own)))
    return tuple(layers)


def rounded(policy: Policy) -> Policy:
    """The policy at half precision, as files of many hold it."""

    def half(value: np.ndarray | None) -> np.ndarray | None:
        return None if value is None else value.astype(np.float16).astype(np.float32)

    return dataclasses.replace(policy, layers=tuple(Layer(*map(half, layer)) for layer in policy.layers))
