"""Who acts in the compiled program: agents that act by the age of the episode are told it, and only they."""

import dataclasses
from functools import partial
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.job import plan, start
from srl_jax.job.teachers import scripted_gait
from srl_jax.program.act import act_rows, fresh_act_state
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import STUDENT, TRAIN, World
from srl_jax.types import GuidanceState

AGES = (0, 2, 3, 5)  # of a lane's four robots


@pytest.fixture(scope="module")
def acting():
    """(choice, mode) -> actions f32[3, 4, 18] and states of acting, of DDPG, SRL and jump-start RL."""
    base = preset("smoke")
    train = dataclasses.replace(base.train, environments=len(AGES))
    config = dataclasses.replace(base, algos="ddpg,srl,jsrl", seeds="1", train=train)
    srl = dataclasses.replace(config.srl, segment=3, commit=False, hidden=(8, 8))
    jsrl = dataclasses.replace(config.jsrl, jump_steps=(3.0,), hidden=(8, 8))
    config = config.with_agents(srl=srl, jsrl=jsrl)
    program = start.make_program(config, lay_out(plan.make(config).lanes, 1), (scripted_gait(),))
    data = start.make_lanes(program, config, (scripted_gait(),), "train", ["leg_rm"] * 3)
    agents = start.init_agents(program, data)
    keys = jax.random.split(jax.random.key(0), (3, len(AGES)))
    act_state = jax.vmap(jax.vmap(partial(fresh_act_state, action_size=ACTION_SIZE)))(keys)
    observation = jnp.zeros((3, len(AGES), program.observation_size))
    env = SimpleNamespace(steps=jnp.broadcast_to(jnp.array(AGES), (3, len(AGES))))

    @jax.jit
    def act(choice, mode):
        guidance = GuidanceState(choice, jnp.zeros_like(choice))
        world = World(env, act_state._replace(guidance=guidance), observation, None)  # type: ignore[arg-type]
        return act_rows(program, data, mode, SimpleNamespace(clock=jnp.int32(40), agents=agents, world=world))

    return act


def test_the_age_of_an_episode_is_told_and_not_carried(acting):
    _, after = acting(jnp.full((3, len(AGES)), 7), TRAIN())
    choice = np.asarray(after.guidance.choice)
    np.testing.assert_array_equal(choice[0], [7, 7, 7, 7])  # DDPG chooses nobody
    np.testing.assert_array_equal(choice[1] < 7, [True, False, True, False])  # SRL, at every third step
    np.testing.assert_array_equal(choice[2], [1, 1, 0, 0])  # three steps are pi_B's
    assert after.age is None


def test_an_evaluation_asks_for_the_student_whatever_the_age(acting):
    action, after = acting(jnp.full((3, len(AGES)), 7), STUDENT())
    assert action.shape == (3, len(AGES), ACTION_SIZE)
    np.testing.assert_allclose(action, np.broadcast_to(np.asarray(action)[:, :1], action.shape), atol=1e-6)
    assert np.all(np.asarray(after.guidance.choice) == 7) and after.age is None
