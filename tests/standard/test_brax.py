"""The robot of Brax's shape is that of the training program, and Brax's own PPO trains it as it is."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.standard.brax import METRICS, Hexapod, among

STEPS = 8
SETTINGS = {"episode_steps": 6}


@pytest.fixture(scope="module")
def walks():
    """Two robots of different damage, by this shape and by the program's own functions, under the same actions."""

    def moved(robot, damage, state, control):  # any physics will do, and this one is soon compiled
        share = 0.1 * damage.body_mass[5]
        return state._replace(qpos=state.qpos.at[7:].set(control).at[:2].add(share), qvel=state.qvel + share)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hexapod, "simulate", moved)
        return two_walks()


def two_walks():
    env = Hexapod("p2p", settings=SETTINGS, clock_hz=1.5)
    damage, axes = among("leg_rm,tibia_lf:limp")(env.sys, jax.random.split(jax.random.key(2), 2))
    keys = jax.random.split(jax.random.key(0), 2)
    actions = jax.random.uniform(jax.random.key(1), (STEPS, 18), minval=-1.0)

    @jax.jit
    @partial(jax.vmap, in_axes=(axes, 0))
    def theirs(damage, key):
        env.sys = damage  # as Brax's wrapper does
        first = env.reset(key)

        def step(state, action):
            state = env.step(state, action)
            return state, state

        return first, jax.lax.scan(step, first, actions)[1]

    @jax.jit
    @partial(jax.vmap, in_axes=(axes, 0))
    def ours(damage, key):
        first, seen = hexapod.reset(env.robot, damage, key)
        step = lambda state, action: hexapod.step(env.robot, damage, state, action)  # noqa: E731
        return seen, jax.lax.scan(step, first, actions)[1]

    return damage, theirs(damage, keys), ours(damage, keys)


def test_it_is_the_programs_robot(walks):
    _, (first, states), (seen, outs) = walks
    np.testing.assert_allclose(first.obs, seen, atol=1e-6)
    assert not first.done.any() and set(first.metrics) == set(METRICS) == set(states.metrics)
    np.testing.assert_allclose(states.obs, outs.observation, atol=1e-5)
    np.testing.assert_allclose(states.reward, outs.reward, atol=1e-5)
    np.testing.assert_array_equal(states.done, outs.terminated)
    np.testing.assert_array_equal(states.info["truncation"], outs.truncated)
    np.testing.assert_allclose(sum(states.metrics[name] for name in METRICS[:4]), states.reward, atol=1e-5)
    assert states.info["truncation"][:, -1].all() and not states.info["truncation"][:, 0].any()


def test_robots_of_a_batch_have_damages_of_their_own(walks):
    damage = walks[0]
    assert damage.body_mass.shape == (2, 20)
    names, many = ("healthy", "leg_rm", "leg_lf"), jax.random.split(jax.random.key(0), 60)
    drawn, _ = among(",".join(names), "x")(jax.tree.map(lambda x: x[0], damage), many)
    stacked = damages.stack(names)
    counts = [sum(np.array_equal(own, mass) for own in drawn.body_mass) for mass in stacked.body_mass]
    assert sum(counts) == 60 and min(counts) > 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "y"}, "task is 'y'"),
        ({"damage": "losses21"}, "losses21"),
        ({"settings": {"physics": "pybullet"}}, "env.physics is 'pybullet': choose one of auto, star, mjx"),
    ],
)
def test_what_makes_no_environment_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Hexapod(**arguments)


def replicated(tree, devices):
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * len(devices)), tree)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Brax's own
def test_brax_trains_it(monkeypatch):
    ppo = pytest.importorskip("brax.training.agents.ppo.train", reason="brax is not installed")
    seen = []
    # Brax 0.14 calls what jax 0.10 no longer has: this is jax's own advice for its replacement.
    monkeypatch.setattr(jax, "device_put_replicated", replicated, raising=False)
    with jax.numpy_rank_promotion("allow"):
        make, _, _ = ppo.train(
            Hexapod("x", settings={"physics": "star"}),
            randomization_fn=among("leg_rm,leg_lf", "x"),
            num_timesteps=2_000,
            episode_length=100,
            num_envs=16,
            num_eval_envs=16,
            num_evals=2,
            batch_size=16,
            num_minibatches=4,
            unroll_length=10,
            num_updates_per_batch=1,
            max_devices_per_host=1,
            progress_fn=lambda step, metrics: seen.append((step, metrics)),
        )
    (start, before), (end, after) = seen
    assert start == 0 and end >= 2_000
    for metrics in (before, after):
        assert np.isfinite(metrics["eval/episode_reward"]) and "eval/episode_reward/effort" in metrics
    assert callable(make)
