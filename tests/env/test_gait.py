"""The scripted gait: its shape, its symmetry, its file, and that the healthy robot walks with it."""

import json
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage, gait, hexapod
from srl_jax.env.anatomy import LEGS, PHANTOMX
from srl_jax.env.settings import EnvConfig
from tests.env.walks import in_every_direction

RF_RR_LM = [LEGS.index(leg) for leg in ("rf", "rr", "lm")]
RM_LF_LR = [LEGS.index(leg) for leg in ("rm", "lf", "lr")]
MIRRORED = [LEGS.index({"r": "l", "l": "r"}[leg[0]] + leg[1]) for leg in LEGS]
LINEAR = gait.Gait(1.5, 0.4, 0.2, -0.1, 0.2, 0.1, 0.1, 0.05, 0.02, 0.2)  # never clipped


def observe(phase, heading):
    """What the gait reads (f32[..., 4]) at clock `phase` (cycles) with the goal `heading` rad to the left."""
    clock = 2 * np.pi * np.asarray(phase)
    parts = np.broadcast_arrays(np.sin(clock), np.cos(clock), np.cos(heading), np.sin(heading))
    return jnp.asarray(np.stack(parts, axis=-1), jnp.float32)


def actions(parameters, phase, heading):
    """Actions f32[..., 6 legs, 3 joints] at every phase and heading."""
    observation = observe(phase, heading)
    rows = jax.vmap(lambda row: gait.act(parameters, row))(observation.reshape(-1, 4))
    return np.asarray(rows).reshape(*observation.shape[:-1], 6, 3)


def grid():
    return np.meshgrid(np.linspace(0, 1, 32, endpoint=False), np.linspace(-np.pi, np.pi, 33), indexing="ij")


def test_actions_stay_in_range():
    acted = actions(gait.load(), *grid())
    assert np.all(np.abs(acted) <= 1.0)
    assert np.all(np.ptp(acted[:, 16, :, 0], axis=0) > 0.1)  # straight ahead, every coxa swings


def test_only_clock_and_direction_are_read():
    observation = jnp.arange(44.0).at[:4].set(observe(0.3, 1.0))
    np.testing.assert_array_equal(gait.act(LINEAR, observation), gait.act(LINEAR, observe(0.3, 1.0)))


def test_tripods_are_in_antiphase():
    phase, heading = grid()
    now, half_a_cycle_later = (actions(LINEAR, phase + shift, heading) for shift in (0.0, 0.5))
    # A foot's lift is the same for all legs, so the femurs' mean over a heading and its opposite is it alone.
    lift = 0.5 * (now + actions(LINEAR, phase, heading + np.pi))[..., 1]
    later = 0.5 * (half_a_cycle_later + actions(LINEAR, phase + 0.5, heading + np.pi))[..., 1]
    for tripod in (RF_RR_LM, RM_LF_LR):
        np.testing.assert_allclose(lift[..., tripod], np.repeat(lift[..., tripod[:1]], 3, axis=-1), atol=1e-6)
    np.testing.assert_allclose(lift[..., RF_RR_LM], later[..., RM_LF_LR], atol=1e-6)
    # Coxae have no offset: half a cycle later they are where they were, mirrored.
    np.testing.assert_allclose(now[..., 0], -half_a_cycle_later[..., 0], atol=1e-6)


@pytest.mark.parametrize("parameters", [LINEAR, gait.load()], ids=["linear", "tuned"])
def test_mirrored_direction_gives_mirrored_strides(parameters):
    phase, heading = grid()
    expected = actions(parameters, phase, heading)[..., MIRRORED, :] * np.array([-1.0, 1.0, 1.0])
    # A leg and its mirror image are of different tripods.
    np.testing.assert_allclose(actions(parameters, phase + 0.5, -heading), expected, atol=1e-5)


def test_is_continuous_where_the_goal_is_straight_behind():
    left, right = (actions(gait.load(), np.linspace(0, 1, 32), side * (np.pi - 1e-3)) for side in (1, -1))
    np.testing.assert_allclose(left, right, atol=1e-2)


def test_file_has_a_value_for_every_parameter():
    values = json.loads(gait.path().read_text())
    assert tuple(values["gait"]) == gait.Gait._fields
    assert values["command"].startswith("python -m experiments.tune_gait")
    np.testing.assert_allclose(np.array(gait.load()), np.array(list(values["gait"].values())), rtol=1e-6)


def test_loads_from_a_file(tmp_path):
    path = tmp_path / "gait.json"
    values = {name: i for i, name in enumerate(gait.Gait._fields)}
    path.write_text(json.dumps({"gait": values}))
    loaded = gait.load(replace(PHANTOMX, gait=str(path)))
    assert loaded.turn.dtype == jnp.float32
    np.testing.assert_array_equal(np.array(loaded), np.arange(len(loaded)))


def test_healthy_robot_walks_in_every_direction():
    parameters = gait.load()
    robot = hexapod.make("p2p", EnvConfig(), float(parameters.frequency))
    healthy = damage.build("healthy")
    path, fell, speed = in_every_direction(robot, healthy, partial(gait.act, parameters))
    assert not np.any(fell)
    assert np.all(np.asarray(path)[..., 2] > 0.06)
    assert speed[0] >= 0.3
    assert np.all(speed >= 0.2)
