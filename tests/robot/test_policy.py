"""Who walks: sees what jax shows, does what jax does, and what a robot cannot run."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from srl_jax import pretrained
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
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
        ({"history": 2}, "reads 2 control steps before"),
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
