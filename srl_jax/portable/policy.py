"""A policy as plain arrays: a network with its weights, and what one must know to run it."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

EPSILON = 1e-6  # of LayerNorm, as flax has it
WEIGHTS = ("kernel", "bias", "scale", "shift")
GRID = 256.0  # of `coarse`: multiples of 1 / 256, of which half precision has all that weights are made of


class Layer(NamedTuple):
    """Dense, and LayerNorm where the network has it; ReLU follows, and tanh the last layer."""

    kernel: np.ndarray  # f32[I, W]
    bias: np.ndarray  # f32[W]
    scale: np.ndarray | None = None  # f32[W] of LayerNorm
    shift: np.ndarray | None = None  # f32[W]

    def map(self, change: Callable[[np.ndarray], np.ndarray]) -> "Layer":
        """The layer with all that it has changed."""
        return self._replace(**{name: change(value) for name, value in self._asdict().items() if value is not None})


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

    @property
    def action_size(self) -> int:
        """A."""
        return len(self.layers[-1].bias)

    @property
    def weights(self) -> dict[str, np.ndarray]:
        """What is not None of the layers, by number of the layer and name, such as ``0/kernel``."""
        return {
            f"{number}/{name}": value
            for number, layer in enumerate(self.layers)
            for name, value in zip(WEIGHTS, layer, strict=True)
            if value is not None
        }

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


def rounded(policy: Policy, precision: str = "half") -> Policy:
    """The policy as files of many hold it.

    Args:
        policy: any.
        precision: full: as it is; half: at half precision; coarse: so, and in multiples of 1 / 256, which compress to
            two thirds of that.
    """

    def kept(value: np.ndarray) -> np.ndarray:
        value = np.round(value * GRID) / GRID if precision == "coarse" else value
        return value.astype(np.float16).astype(np.float32)

    if precision == "full":
        return policy
    return dataclasses.replace(policy, layers=tuple(layer.map(kept) for layer in policy.layers))


def pick(policies: Sequence[Policy], damages: Sequence[str], source: str) -> list[Policy]:
    """Those that were learned for some damages; none named: all.

    Raises:
        ValueError: there is none for one of the damages.
    """
    there = list(dict.fromkeys(policy.about["damage"] for policy in policies))
    for damage in damages:
        if damage not in there:
            raise ValueError(f"damage is {damage!r}: {source} has policies for {', '.join(there)}.")
    return [policy for policy in policies if policy.about["damage"] in (damages or there)]


def layers(actor: Mapping[str, Any]) -> tuple[Layer, ...]:
    """An actor's parameters (`agents.networks.Actor`) as plain arrays, from the observation to the action."""
    params: Mapping[str, Any] = actor["params"]
    torso = params.get("Torso_0", {})
    found = []
    for number in range(sum(name.startswith("Dense_") for name in torso)):
        dense, norm = torso[f"Dense_{number}"], torso.get(f"LayerNorm_{number}", {})
        found.append(Layer(dense["kernel"], dense["bias"], norm.get("scale"), norm.get("bias")))
    found.append(Layer(params["action"]["kernel"], params["action"]["bias"]))
    return tuple(layer.map(lambda value: np.asarray(value, np.float32)) for layer in found)


def parameters(layers: Sequence[Layer]) -> dict[str, Any]:
    """The parameters of `agents.networks.Actor` that layers are: what `layers` undoes."""
    torso: dict[str, Any] = {}
    for number, layer in enumerate(layers[:-1]):
        torso[f"Dense_{number}"] = {"kernel": layer.kernel, "bias": layer.bias}
        if layer.scale is not None:
            torso[f"LayerNorm_{number}"] = {"scale": layer.scale, "bias": layer.shift}
    return {"params": {"Torso_0": torso, "action": {"kernel": layers[-1].kernel, "bias": layers[-1].bias}}}
