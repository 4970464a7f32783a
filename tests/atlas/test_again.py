"""A robot that walks far worse than it hoped thinks again, from where it is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import matrix, recovery, twins
from srl_jax.atlas.belief import Belief
from srl_jax.atlas.choice import Choice
from srl_jax.atlas.mind import STEPS, widened
from srl_jax.atlas.robots import CRobot
from srl_jax.env import damage
from srl_jax.program import strides

TURNED = 0.8  # rad


@pytest.fixture(scope="module")
def thought(atlas):
    """Mind, knowledge, scope and the memory of six steps of a robot that has lost two legs and faces elsewhere."""
    mind, known, scope = recovery.mind_of(atlas), recovery.knowledge(atlas), recovery.scope(atlas)
    body = CRobot("leg_rf+leg_lr", 0)
    senses = body.reset()
    memory = jax.jit(mind.begin)(known, scope, jax.random.key(0))
    think = jax.jit(mind.think)
    for _ in range(6):
        memory = think(known, scope, memory, senses)
        senses = body.step(np.asarray(memory.action))
    log = jnp.log(jnp.full(len(atlas.damages) + twins.ROOM + 1, 1e-6)).at[3].set(0.0)
    towards = np.float32([np.cos(TURNED), -np.sin(TURNED)])
    return mind, known, scope, memory._replace(belief=Belief(log)), senses._replace(towards=towards)


def test_all_policies_are_tried_from_the_pose_of_the_likeliest_in_the_direction_that_is_felt(atlas, thought):
    mind, known, scope, memory, senses = thought
    hypothesis, worth = jax.jit(mind.again)(known, scope, memory, senses)
    assert int(hypothesis) == 3 and worth.shape == (4 + twins.ROOM,)
    state = jax.tree.map(lambda leaf: leaf[3], memory.states)
    start = strides.turned(state, TURNED - float(_heading(state)))._replace(phase=memory.phase)
    assert abs(float(_heading(start)) - TURNED) < 1e-4
    actor = jax.tree.map(lambda leaf: jnp.asarray(leaf[1]), atlas.actors)
    own = jax.tree.map(jnp.asarray, damage.build("leg_rf+leg_lr"))
    speed, fell = jax.jit(lambda: matrix.walk(mind.robot, mind.network, STEPS, actor, own, start))()
    np.testing.assert_allclose(worth[1], speed * (1.0 - fell) / known.healthy_speed, atol=0.02)


def _heading(state):
    w, x, y, z = state.qpos[3:7]
    return jnp.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


@pytest.mark.parametrize(("come", "expected"), [(0.02, True), (0.49, False)])
def test_it_is_disappointed_by_a_segment_that_was_worth_far_less_than_it_hoped(thought, come, expected):
    """Policy 3 is worth .5 m/s under damage 3: half a metre in the second of a segment that counts."""
    mind, known, scope, memory, senses = thought
    wide = widened(known, scope)
    pace = mind.settings.pace
    walked = memory._replace(choice=Choice(jnp.int32(3), jnp.int32(pace.hold - 1), jnp.float32(0.0)))
    felt = senses._replace(come=np.float32(come))
    _, trials, _, ended = mind.choose(*wide, walked, memory.belief, felt, jax.random.key(1))
    assert bool(ended.disappointing) == expected and int(trials.count) == int(memory.trials.count) + 1
    begun = memory._replace(choice=Choice(jnp.int32(3), jnp.int32(3), jnp.float32(0.0)))
    running = mind.choose(*wide, begun, memory.belief, felt, jax.random.key(1))[3]
    assert not bool(running.disappointing) and np.isnan(running.worth), "no segment is over"


def test_what_it_thought_again_replaces_one_column(atlas, thought):
    _, known, scope, *_ = thought
    composer = twins.Composer(atlas.damages, lambda own: own, lambda own, log: own, [scope.twins])
    composer.unsure.add(0)
    composer.revise(0, 2, np.arange(4.0 + twins.ROOM))
    wide = widened(known, scope._replace(twins=composer.twins[0]))[0]
    np.testing.assert_array_equal(wide.value[:, 2], np.arange(4.0 + twins.ROOM))
    np.testing.assert_array_equal(wide.value[:4, [0, 1, 3]], known.value[:, [0, 1, 3]])
    assert not composer.unsure
