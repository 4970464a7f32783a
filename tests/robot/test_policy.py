"""Who walks: sees what jax shows, does what jax does, and what a robot cannot run."""

import dataclasses
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from srl_jax import pretrained
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.interface import layout
from srl_jax.env.senses import Senses
from srl_jax.env.settings import EnvConfig
from srl_jax.robot.policy import Walker


@pytest.mark.parametrize("kind", ["onboard", "rates"])
def test_what_it_sees_is_what_jax_shows(kind):
    import jax

    robot = hexapod.make("x", EnvConfig(observation=kind, physics="mjx"), 1.5)
    damage = damages.build("leg_rm")
    state, seen = hexapod.reset(robot, damage, jax.random.key(1))
    policy = pretrained.load("atlas", task="x", damage="leg_rm")
    about = policy.about | {"kind": kind}
    first = policy.layers[0]
    wide = first._replace(kernel=np.resize(first.kernel, (len(seen), first.kernel.shape[1])))
    walker = Walker(dataclasses.replace(policy, layers=(wide, *policy.layers[1:]), about=about))
    walker.phase = float(state.phase)
    senses = jax.tree.map(np.asarray, hexapod.feel(robot, damage, state))
    own, action = walker.act(senses)
    assert own.dtype == np.float32 and np.allclose(own, seen, atol=1e-6)
    assert np.allclose(action, walker.policy(np.asarray(seen)), atol=1e-5) and np.abs(action).max() <= 1.0
    assert np.allclose(walker.offsets(np.ones(18)), np.tile(hexapod.ACTION_SCALE, 6))


def seeing(steps: int):
    """A policy that sees so many steps behind it."""
    import jax

    policy = pretrained.load("atlas", task="x", damage="leg_rm")
    first, about = policy.layers[0], policy.about | {"history": steps}
    size = sum(size for _, size in layout("x", "onboard", steps))
    kernel = 0.1 * np.asarray(jax.random.normal(jax.random.key(0), (size, first.kernel.shape[1])))
    return dataclasses.replace(policy, layers=(first._replace(kernel=kernel), *policy.layers[1:]), about=about)


def test_the_steps_behind_it_are_those_that_jax_shows():
    import jax

    robot = hexapod.make("x", EnvConfig(observation="onboard", history=3, physics="mjx"), 1.5)
    damage = damages.build("leg_rm")
    step, feel = jax.jit(partial(hexapod.step, robot, damage)), jax.jit(partial(hexapod.feel, robot, damage))
    state, seen = hexapod.reset(robot, damage, jax.random.key(1))
    policy = seeing(3)
    walker = Walker(dataclasses.replace(policy, about=policy.about | {"clock_hz": 1.5}))
    for number in range(5):  # after four of them nothing is zero any more
        walker.phase = float(state.phase)
        own, action = walker.act(jax.tree.map(np.asarray, feel(state)))
        assert np.allclose(own, seen, atol=1e-5)
        assert np.count_nonzero(own[-3 * 39 :].reshape(3, 39).any(axis=1)) == min(number, 3)
        state, out = step(state, action)
        walker.advance()
        seen = out.observation
    walker.restart()
    assert not walker.see(jax.tree.map(np.asarray, feel(state)))[-3 * 39 :].any()


def test_a_step_that_took_two_stands_twice_behind_it_and_another_policy_of_its_kind_sees_them():
    walker = Walker(seeing(2))
    senses = Senses(
        *(np.ones(n, np.float32) for n in (18, 18)), np.ones(18, bool), *(np.ones(n) for n in (3, 3, 2)), 2, 0
    )
    _, action = walker.act(senses)
    walker.advance(2)
    walker.swap(seeing(2))
    rows = walker.see(senses)[-2 * 39 :].reshape(2, 39)
    assert (rows[0] == rows[1]).all() and (rows[0, -18:] == action).all() and rows[0, 0] == 1.0
    walker.swap(seeing(1))
    assert not walker.see(senses)[-39:].any()


def test_the_clock_goes_on_and_the_policy_may_be_exchanged():
    one, other = (pretrained.load("atlas", task="x", damage=name) for name in ("healthy", "leg_rm"))
    walker = Walker(one)
    walker.advance(3)
    expected = 3 * one.about["clock_hz"] / 20 % 1
    walker.swap(other)
    assert walker.phase == pytest.approx(expected) and walker.policy is other
    with pytest.raises(ValueError, match="'full', of which a robot's sensors give onboard and rates only"):
        walker.swap(pretrained.load("srl", task="x", damage="healthy"))
    assert walker.policy is other


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"kind": "full"}, "reads the observation 'full'"),
        ({"task": "p2p"}, "is for task 'p2p', for which a robot must know where it is"),
        ({"history": 2}, "reads 25 numbers and gives 18: this robot has 103 of onboard for x"),
        ({"kind": "rates"}, "reads 25 numbers and gives 18: this robot has 46 of rates for x"),
        ({"control_hz": 50.0}, "acts at 50.0 Hz"),
    ],
)
def test_what_a_robot_cannot_run_is_one_sentence(changed, message):
    policy = pretrained.load("atlas", task="x", damage="healthy")
    with pytest.raises(ValueError, match=message):
        Walker(dataclasses.replace(policy, about=policy.about | changed))


def test_the_room_and_the_verb_need_no_jax(tmp_path):
    from srl_jax import portable

    portable.save(tmp_path / "own.npz", [pretrained.load("atlas", task="x", damage="healthy")])
    code = f"""
import sys
for name in ("jax", "jaxlib", "mujoco", "flax", "optax", "chex", "distrax", "orbax"):
    sys.modules[name] = None
import pkgutil, importlib, srl_jax.robot
for found in pkgutil.walk_packages(srl_jax.robot.__path__, "srl_jax.robot."):
    if not found.name.endswith("__main__"):
        importlib.import_module(found.name)
from srl_jax.cli import deploy, deploy_story
deploy.main([{str(tmp_path / "own.npz")!r}, "--port", "/dev/nowhere", "--imu", "none"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "port is /dev/nowhere: it cannot be opened as a serial port" in done.stderr
