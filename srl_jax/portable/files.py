"""Files of policies: .npz, small and exact, and .json, for people and for other languages."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from srl_jax import arrays
from srl_jax.portable.policy import WEIGHTS, Layer, Policy

Weights = dict[str, np.ndarray]  # as `Policy.weights`


def save(path: str | Path, policies: Sequence[Policy], *, half: bool = False) -> None:
    """Writes policies as one file, all of it or nothing: JSON where the path ends in .json, an .npz otherwise.

    Args:
        path: of the file.
        policies: in the order in which `load` gives them.
        half: an .npz holds them at half precision.
    """
    path = Path(path)
    if path.suffix == ".json":
        partial = path.with_suffix(".partial")
        partial.write_text("".join(_text(policies)))
        partial.replace(path)
        return
    kept = np.float16 if half else np.float32
    named = {
        f"{number}/{name}": np.asarray(value, kept)
        for number, policy in enumerate(policies)
        for name, value in policy.weights.items()
    }
    arrays.save(path, about=np.array(json.dumps([policy.about for policy in policies])), **named)


def load(path: str | Path) -> list[Policy]:
    """The policies in a file, .npz or .json.

    Raises:
        ValueError: there is no such file, or it holds no policies.
    """
    path = Path(path)
    with arrays.reading(path, "policies", "export"):
        policies = _from_text(path) if path.suffix == ".json" else _from_arrays(path)
        if not policies or not all(policy.layers for policy in policies):
            raise KeyError("layers")
        return policies


def _layers(weights: Weights) -> tuple[Layer, ...]:
    found: list[Layer] = []
    while f"{len(found)}/kernel" in weights:
        own = {name: weights.get(f"{len(found)}/{name}") for name in WEIGHTS}
        found.append(Layer(**{name: value.astype(np.float32) for name, value in own.items() if value is not None}))
    return tuple(found)


def _from_arrays(path: Path) -> list[Policy]:
    found = arrays.load(path)
    each = json.loads(str(found.pop("about")))
    own: list[Weights] = [{} for _ in each]
    for place, value in found.items():
        number, _, name = place.partition("/")
        own[int(number)][name] = value
    return [Policy(_layers(weights), about) for weights, about in zip(own, each, strict=True)]


def _text(policies: Sequence[Policy]) -> Iterator[str]:
    """JSON with a line for each row of a matrix; every number is the shortest that is exact at single precision."""
    yield "["
    for number, policy in enumerate(policies):
        about = {name: json.dumps(value) for name, value in policy.about.items()}
        weights = {name: _rows(value) for name, value in policy.weights.items()}
        yield f'{"," * bool(number)}\n{{\n"about": {_members(about)},\n"weights": {_members(weights)}\n}}'
    yield "\n]\n"


def _members(texts: dict[str, str]) -> str:
    return "{\n" + ",\n".join(f"{json.dumps(name)}: {text}" for name, text in texts.items()) + "\n}"


def _rows(value: np.ndarray) -> str:
    if value.ndim > 1:
        return "[\n" + ",\n".join(map(_rows, value)) + "\n]"
    return json.dumps([float(str(number)) for number in value])


def _from_text(path: Path) -> list[Policy]:
    stored: Any = json.loads(path.read_text())
    own = [{name: np.array(value, np.float32) for name, value in each["weights"].items()} for each in stored]
    return [Policy(_layers(weights), each["about"]) for weights, each in zip(own, stored, strict=True)]
