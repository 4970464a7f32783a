"""What lies in the file of an atlas, as plain arrays. Imports no jax, so that its policies can be taken home."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from srl_jax import arrays
from srl_jax.agents.settings import DDPGConfig
from srl_jax.env import damage_names
from srl_jax.env.interface import facts
from srl_jax.portable import Policy
from srl_jax.portable.policy import layers

DATA = Path(__file__).with_name("atlas.npz")
MEASURED = ("speed", "falls", "whitening")
ACTOR = "actor"  # what the names of a network's arrays begin with


class Atlas(NamedTuple):
    """I policies and D damages; with one seed a damage, I = D and policy i was trained for damage i."""

    damages: tuple[str, ...]  # D canonical names, healthy first
    trained_for: tuple[str, ...]  # I of them, by policy
    actors: Any  # leaves [I, ...], see `types.Params`
    speed: np.ndarray  # f32[I, D] m/s that policy i keeps under damage d, its falls counted as they came
    falls: np.ndarray  # f32[I, D] share of the walks in which it fell
    whitening: np.ndarray  # f32[24, 24] of the residuals, see `belief.Likelihood`
    about: dict[str, Any]  # task, observation, clock_hz, hidden, layer_norm; the command, steps, versions

    @property
    def network(self) -> DDPGConfig:
        """The architecture of the policies."""
        return DDPGConfig(hidden=tuple(self.about["hidden"]), layer_norm=self.about["layer_norm"])

    @property
    def value(self) -> np.ndarray:
        """f32[I, D] what a policy is worth under a damage: its share of the healthy speed, nothing where it falls."""
        return self.speed * (1.0 - self.falls) / self.healthy_speed

    @property
    def healthy_speed(self) -> float:
        """m/s of the healthy robot under the policy that was trained on it."""
        return float(self.speed[self.trained_for.index(damage_names.HEALTHY), 0])


def read(path: str | Path = "") -> Atlas:
    """The atlas in a file, or the one that ships with the package where `path` is empty.

    Raises:
        ValueError: there is no such file, or it is no atlas.
    """
    path = Path(path) if path else DATA
    with arrays.reading(path, "an atlas", "atlas"):
        found = arrays.load(path)
        about = json.loads(str(found.pop("about")))
        damages, trained_for = tuple(about.pop("damages")), tuple(about.pop("trained_for"))
        measured = {name: found.pop(name) for name in MEASURED}
    shape = (len(trained_for), len(damages))
    if any(measured[name].shape != shape for name in ("speed", "falls")):
        raise ValueError(f"{path} is damaged: its matrix has not a row a policy and a column a damage.")
    return Atlas(damages, trained_for, _nested(found), **measured, about=about)


def _nested(networks: dict[str, np.ndarray]) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for name, array in networks.items():
        _, *above, last = name.split("/")
        branch = tree
        for key in above:
            branch = branch.setdefault(key, {})
        branch[last] = array.astype(np.float32)
    return tree


def policies(atlas: Atlas) -> dict[str, Policy]:
    """The first policy that an atlas has for each damage, to take home."""
    shared = facts(atlas.about["task"], atlas.about["observation"], atlas.about["clock_hz"])
    shared |= {name: atlas.about[name] for name in ("command", "versions")}
    found: dict[str, Policy] = {}
    for row, damage in enumerate(atlas.trained_for):
        about = {"algo": "srl", "method": "srl", "damage": damage, "seed": 0} | shared
        found.setdefault(damage, Policy(layers(_row(atlas.actors, row)), about))
    return found


def _row(tree: Any, row: int) -> Any:
    return {key: _row(value, row) for key, value in tree.items()} if isinstance(tree, dict) else tree[row]
