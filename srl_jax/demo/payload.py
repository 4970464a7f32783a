"""What the page carries: the robot, damages as leaves of its model, policies, and how the robot finds out."""

import base64
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from srl_jax.atlas import belief, choice, tracking, trials
from srl_jax.atlas.file import Atlas
from srl_jax.env import damage as damages
from srl_jax.env import gait, senses
from srl_jax.env.anatomy import LEGS, PHANTOMX
from srl_jax.env.damage import Damage
from srl_jax.env.damage_names import HEALTHY, canonical, catalogue
from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ, SUBSTEPS, UPRIGHT
from srl_jax.env.model import load_model, xml_text
from srl_jax.env.settings import EnvConfig
from srl_jax.portable import WEIGHTS, Policy

LEARNED = (
    "What {} has learned for this damage, from standing starts: so the robot stands for a second before it takes over, "
    "and takes its heading as the one to walk in."
)


def robot(clock_hz: float, names: Iterable[str]) -> dict[str, Any]:
    """The robot and what may become of it.

    Args:
        clock_hz: of the gait's clock that policies see.
        names: damages that the page can show.
    """
    whole = damages.damaged_model(HEALTHY)
    return {
        "xml": xml_text(),
        "timestep": load_model().opt.timestep,
        "substeps": SUBSTEPS,
        "control_hz": CONTROL_HZ,
        "clock_hz": clock_hz,
        "action_scale": list(ACTION_SCALE) * 6,
        "upright": UPRIGHT,
        "noise": senses.NOISE,
        "goal_radius": EnvConfig().goal_radius,
        "damages": {name: _leaves(whole, name) for name in dict.fromkeys((HEALTHY, *names))},
    }


def _leaves(whole: Any, name: str) -> dict[str, Any]:
    """The leaves of the model in which a damaged robot differs from a healthy one, as the package computes them."""
    model, changed = damages.damaged_model(name), {}
    for field in Damage._fields:
        old, new = np.ravel(getattr(whole, field)), np.ravel(getattr(model, field))
        at = np.flatnonzero(old != new)
        if len(at):
            changed[field] = {"at": at.tolist(), "value": new[at].tolist()}
    silent = np.flatnonzero(~np.asarray(damages.present(damages.build(name)))).tolist()
    return {"changed": changed, "silent": silent}


def reachable(names: Iterable[str], most: int = 3) -> list[str]:
    """Damages that clicks may lead to: these, the catalogue, `most` whole legs lost, and two legs or tibiae."""
    lost = [f"leg_{leg}" for leg in LEGS]
    parts = [*lost, *(f"tibia_{leg}" for leg in LEGS)]
    legs = [some for count in range(1, most + 1) for some in combinations(lost, count)]
    pairs = [pair for pair in combinations(parts, 2) if pair[0][-2:] != pair[1][-2:]]
    combined = [canonical("+".join(some)) for some in (*legs, *pairs)]
    return list(dict.fromkeys([*map(canonical, names), *catalogue(), *combined]))


def policy(own: Policy) -> dict[str, Any]:
    """A network at half precision."""
    layers = [
        {name: _packed(value) for name, value in zip(WEIGHTS, layer, strict=True) if value is not None}
        for layer in own.layers
    ]
    return {"layers": layers}


def _packed(values: np.ndarray) -> str:
    return base64.b64encode(np.asarray(values, "<f2").tobytes()).decode("ascii")


def tripod() -> dict[str, Any]:
    """The scripted gait, pi_B."""
    own = {name: float(value) for name, value in gait.load()._asdict().items()}
    mount = np.deg2rad(np.array(PHANTOMX.mounts, np.float32))
    return {"gait": own, "mount": mount.tolist(), "tripod": list(PHANTOMX.phases)}


def of_atlas(policies: dict[str, Policy], about: str) -> dict[str, Any]:
    """The robot that finds out by itself, beside one that is told and one that knows nothing."""
    sets = {"atlas": {damage: policy(own) for damage, own in policies.items()}}
    return {
        "said": "atlas: prepared before the damage",
        "about": about,
        "task": "x",
        "observation": next(iter(policies.values())).about["kind"],
        "takes_over": True,
        "finds_out": True,
        "sets": sets,
        "methods": [
            _method("unaware", "knows nothing", "nothing", "atlas", "It walks on as if it were healthy."),
            _method("told", "is told", "told", "atlas", "Somebody names the damage, and its policy takes over."),
            _method(
                "posterior",
                "finds out",
                "supposed",
                "atlas",
                "It predicts under every damage what it will feel, believes those that are right, and walks by what is "
                "best under that belief.",
            ),
        ],
    }


def of_run(policies: Sequence[Policy], about: str) -> dict[str, Any]:
    """The methods of a run side by side, each with what it has learned for a damage, and pi_B."""
    sets: dict[str, dict[str, Any]] = {"pi_B": {HEALTHY: tripod()}}
    for own in policies:
        sets.setdefault(own.about["method"], {}).setdefault(own.about["damage"], policy(own))
    first = policies[0].about
    learned = [
        _method(name, said := name.upper() if name in ("srl", "ddpg") else name, "told", name, LEARNED.format(said))
        for name in sets
        if name != "pi_B"
    ]
    return {
        "said": f"run: {', '.join(name for name in sets if name != 'pi_B')} on {first['task']}",
        "about": about,
        "task": first["task"],
        "observation": first["kind"],
        "takes_over": False,
        "finds_out": False,
        "sets": sets,
        "methods": [_method("pi_B", "pi_B", "nothing", "pi_B", "The tripod of the healthy robot goes on."), *learned],
    }


def _method(name: str, said: str, knows: str, own: str, how: str) -> dict[str, str]:
    return {"name": name, "said": said, "knows": knows, "set": own, "how": how}


def mind(atlas: Atlas, names: Sequence[str]) -> dict[str, Any]:
    """How a robot finds out, among these damages of an atlas."""
    rows = [atlas.trained_for.index(name) for name in names]
    columns = [atlas.damages.index(name) for name in names]
    likelihood = belief.Likelihood(atlas.whitening)._asdict()  # pyright: ignore[reportArgumentType]
    whitening = likelihood.pop("whitening")
    return {
        "damages": list(names),
        "trained_for": list(names),
        "value": np.round(atlas.value[np.ix_(rows, columns)], 4).tolist(),
        "whitening": whitening.tolist(),
        "gains": tracking.GAINS._asdict(),
        "likelihood": likelihood,
        "prior_healthy": belief.HEALTHY,
        "flat": trials.PRIOR.flat,
        "pace": {"hold": choice.PACE.hold, "margin": choice.PACE.margin},
    }
