"""The robot under Gymnasium's names: made by its name, accepted by Gymnasium's own check, and trained in."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from srl_jax.env.interface import layout
from srl_jax.standard.gym import NAME, Hexapod

SMALL = {"size": (32, 24), "painter": "plain", "render_mode": "rgb_array"}


def test_gymnasium_accepts_it():
    env = gymnasium.make(f"srl_jax.standard.gym:{NAME}", task="xy", damage="leg_rm", **SMALL)
    with pytest.warns(UserWarning, match="infinity"):  # observations have no bounds
        check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("kind", ["onboard", "rates", "full"])
@pytest.mark.parametrize("task", ["x", "p2p"])
def test_observations_are_laid_out_as_the_page_of_policies_says(task, kind):
    env = Hexapod(task, settings={"observation": kind, "history": 1})
    observation, _ = env.reset(seed=0)
    assert observation.shape == (sum(size for _, size in layout(task, kind, 1)),)
    assert observation in env.observation_space


def test_an_episode_ends_by_itself_and_can_be_had_again():
    env, walks = gymnasium.make(NAME, task="x", settings={"episode_steps": 5}), []
    for _ in range(2):
        observation, _ = env.reset(seed=3)
        seen, ended = [observation], False
        while not ended:
            observation, reward, terminated, truncated, about = env.step(np.full(18, 0.2))
            assert reward == pytest.approx(sum(value for name, value in about.items() if name.startswith("reward/")))
            seen.append(observation)
            ended = terminated or truncated
        walks.append(np.stack(seen))
    assert len(walks[0]) == 6 and truncated and not terminated
    np.testing.assert_array_equal(*walks)


def test_actions_beyond_the_bounds_count_as_the_bounds():
    reached = []
    for size in (1.0, 7.0):
        env = Hexapod("x")
        env.reset(seed=0)
        reached.append(env.step(np.full(18, size))[0])
    np.testing.assert_array_equal(*reached)


def test_damage_is_drawn_asked_for_or_strikes():
    env = Hexapod("x", damage="losses21")
    drawn = {env.reset(seed=seed)[1]["damage"] for seed in range(20)}
    assert len(drawn) > 5 and drawn <= set(env.damages)
    assert env.reset(options={"damage": "tibia_lf:limp"})[1] == {"damage": "tibia_lf:limp"}
    env.strike("leg_rm")
    assert env.robot.damage == "leg_rm"


def test_finer_physics_goes_elsewhere_and_takes_as_long():
    ends = {}
    for physics in ("training", "converged"):
        env = Hexapod("x", physics=physics)
        env.reset(seed=0)
        for action in np.random.default_rng(0).uniform(-1.0, 1.0, (10, 18)):
            env.step(action)
        ends[physics] = env.robot.data.time, env.robot.data.qpos.copy()
    (time, pose), (fine_time, fine_pose) = ends.values()
    assert time == pytest.approx(fine_time) == pytest.approx(0.5)
    assert 1e-6 < np.abs(pose - fine_pose).max() < 0.3


def test_pictures_follow_the_robot_and_its_damage():
    env = Hexapod("p2p", damage="healthy", **SMALL)
    env.reset(seed=0)
    still = env.render()
    assert still.shape == (24, 32, 3) and still.dtype == np.uint8
    np.testing.assert_array_equal(still, env.render())
    for _ in range(8):
        env.step(np.ones(18))
    moved = env.render()
    assert (moved != still).any()
    env.strike("leg_rm+leg_lm")
    assert (env.render() != moved).any()
    assert Hexapod("x").render() is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "y"}, "task is 'y': choose one of x, xy, p2p"),
        ({"damage": "leg_zz"}, "leg_zz"),
        ({"physics": "star"}, "physics is 'star': choose one of training, converged"),
        ({"render_mode": "human"}, "render_mode is 'human': choose one of None, 'rgb_array'"),
        ({"settings": {"observe": "full"}}, "settings has 'observe': choose from episode_steps"),
        ({"settings": {"observation": "all"}}, "env.observation is 'all': choose one of full, onboard, rates"),
        ({"settings": {"episode_steps": 0}}, "env.episode_steps is 0: it must be at least 1"),
        ({"settings": {"stride_starts": 0.5}}, "env.stride_starts is 0.5"),
    ],
)
def test_what_makes_no_environment_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Hexapod(**arguments)


def test_what_makes_no_step_or_start_is_refused():
    env = Hexapod("x")
    with pytest.raises(ValueError, match="options has 'goal': only damage is accepted"):
        env.reset(options={"goal": (1.0, 0.0)})
    env.reset()
    with pytest.raises(ValueError, match=r"action has the shape \(1, 18\): \(18,\) is accepted"):
        env.step(np.zeros((1, 18)))


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_stable_baselines_trains_in_it(algorithm):
    library = pytest.importorskip("stable_baselines3", reason="the extra bench is not installed")
    options = {"PPO": {"n_steps": 128, "batch_size": 64}, "SAC": {"learning_starts": 50, "batch_size": 32}}[algorithm]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torch's own
        env = gymnasium.make(NAME, task="x", damage="leg_rm")
        agent = getattr(library, algorithm)("MlpPolicy", env, seed=0, device="cpu", **options)
        before = [x.detach().clone() for x in agent.policy.parameters()]
        agent.learn(256)
    assert agent.num_timesteps >= 256
    assert any((x != y).any() for x, y in zip(before, agent.policy.parameters(), strict=True))
    action, _ = agent.predict(env.reset(seed=0)[0], deterministic=True)
    assert action in env.action_space
