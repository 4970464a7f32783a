"""The compiled chunk: what it stores and leaves alone; rows do not touch each other; one program serves all."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import hexapod
from srl_jax.job import start
from srl_jax.job import teachers as sources
from srl_jax.program import engine as engines
from srl_jax.program import lanes, replay
from srl_jax.program.state import STUDENT, TEACHER, TRAIN

E = 2


@pytest.fixture(scope="module")
def data(engine, teachers):
    """The rows' constants."""
    names = [lane.damage for lane in engine.program.layout.rows]
    return engines.lane_data(engine.program, teachers, "train", names)


def trained(engine, data, steps, edit=lambda state: state, mode=None):
    """A fresh state, edited, after some vector steps."""
    state = edit(start.init_state(engine, data))
    return engine.chunk(state, data, mode or TRAIN(), steps)


def row(tree, index):
    return jax.tree.map(lambda x: np.asarray(jax.random.key_data(x) if _is_key(x) else x)[index], tree)


def _is_key(x):
    return jnp.issubdtype(x.dtype, jax.dtypes.prng_key)


def assert_same(left, right):
    jax.tree.map(np.testing.assert_array_equal, left, right)


def rows_of_lane(state, engine, index):
    """Everything a lane owns: its replay, robots and agent."""
    algo = engine.program.layout.rows[index].algo
    position = [i for i, lane in enumerate(engine.program.layout.rows) if lane.algo == algo].index(index)
    return row((state.replay, state.world, state.alive), index), row(state.agents[algo], position)


def test_layout_has_every_algorithm_on_every_device(engine):
    assert [lane.algo for lane in engine.program.layout.rows] == ["ddpg", "srl", "bpg"] * 2


def test_transitions_are_stored_in_order_and_chain(engine, data, tiny):
    state, _ = trained(engine, data, 12)
    size = hexapod.observation_size(tiny.task, tiny.env)
    rows = replay.unpack(np.asarray(state.replay.rows), size)
    assert int(state.clock) == 12 * E
    assert np.all(np.asarray(state.replay.rows)[:, 12 * E :] == 0.0)
    assert np.all(np.abs(rows.action) <= 1.0)
    # Robot 0 of a lane fills every E-th row; within an episode of 10 steps each step starts where the last ended.
    first = jax.tree.map(lambda x: x[:, : 10 * E : E], rows)
    np.testing.assert_array_equal(first.next_observation[:, :-1], first.observation[:, 1:])
    # The 11th step starts anew, but what the 10th reached was stored as it was before the reset.
    tenth, eleventh = rows.next_observation[:, 9 * E], rows.observation[:, 10 * E]
    assert np.abs(tenth - eleventh).max(axis=1).min() > 1e-3


def test_ring_wraps(engine, data, tiny):
    few, _ = trained(engine, data, 4)
    before = np.asarray(few.replay.rows)[:, :E].copy()
    state, _ = trained(engine, data, tiny.train.capacity // E + 1)
    assert int(state.clock) == tiny.train.capacity + E
    assert not np.array_equal(np.asarray(state.replay.rows)[:, :E], before)
    assert np.all(np.abs(np.asarray(state.replay.rows)).sum(-1) > 0.0)


def test_agents_learn_only_when_asked(engine, data):
    fresh = jax.device_get(start.init_state(engine, data).agents)
    idle, _ = trained(engine, data, 20, mode=STUDENT())
    assert_same(jax.device_get(idle.agents), fresh)
    assert np.all(np.asarray(idle.replay.rows) == 0.0)
    busy, tally = trained(engine, data, 20)
    assert float(tally.updates) == 7  # at every other step, from the 8th on, which fills the warm-up of 16
    for algo in ("ddpg", "srl"):
        for name in ("actor", "critic", "target_actor", "target_critic"):
            new, old = getattr(busy.agents[algo], name), getattr(fresh[algo], name)
            moved = jax.tree.map(lambda n, o: np.abs(np.asarray(n) - o).max(), new, old)
            assert max(jax.tree.leaves(moved)) > 0.0, (algo, name)


def test_a_search_counts_finished_episodes_and_takes_a_step_when_there_are_enough(engine, data):
    ten, _ = trained(engine, data, 10)  # the first episodes of both robots end, whether they fell or not
    searches = jax.device_get(ten.agents["bpg"])
    assert np.all(searches.count == 0) and np.all(searches.since > 0)
    assert np.all(np.abs(searches.actor["offset"]).max(1) > 0.0)
    watched, tally = trained(engine, data, 10, mode=STUDENT())
    assert np.all(jax.device_get(watched.agents["bpg"].since) == 0), "an evaluation is no trial"
    trained_, tally = trained(engine, data, 12)
    chosen = {name: np.asarray(tally.rates[name]) for name in ("chosen_teacher", "chosen_1", "chosen_2")}
    np.testing.assert_allclose(chosen["chosen_teacher"], chosen["chosen_1"] + chosen["chosen_2"])
    assert chosen["chosen_teacher"][1] > 0.0, "SRL never took a teacher"
    assert np.all(np.asarray(trained_.alive))


def test_teacher_mode_acts_as_the_gait(engine, data):
    state = start.init_state(engine, data)
    before = row(state.world.observation, 0)
    teacher = sources.scripted_gait()
    after, _ = engine.chunk(state, data, TEACHER(), 1)
    robot = engine.program.robot
    damage = jax.tree.map(lambda x: x[0], data.damage)
    env, _ = hexapod.reset(robot, damage, jax.random.split(data.key[0], E)[0])
    action = jnp.clip(teacher.apply(teacher.params(engine.program.layout.rows[0]), jnp.asarray(before[0])), -1.0, 1.0)
    env, step = jax.jit(lambda d, e, a: hexapod.step(robot, d, e, a))(damage, env, action)
    np.testing.assert_allclose(row(after.world.observation, 0)[0], step.observation, atol=1e-4)


def test_a_row_does_not_depend_on_its_neighbours(engine, data):
    base, _ = trained(engine, data, 20)
    others = data.key.at[1:].set(jax.random.split(jax.random.key(99), len(data.key) - 1))
    damage = engines.damage_rows(["leg_rm", "leg_lf", "healthy", "tibia_rr:limp", "leg_rf", "leg_lr"])
    changed = engines.on_rows(engine.program, data._replace(key=others, damage=damage))
    other, _ = trained(engine, changed, 20)
    assert_same(rows_of_lane(base, engine, 0), rows_of_lane(other, engine, 0))
    assert not np.array_equal(row(base.world.observation, 1), row(other.world.observation, 1))


def test_a_row_does_not_depend_on_the_width_of_the_program(engine, data, tiny, teachers):
    """Alone on one device: other widths round differently, so 1e-4 (bitwise is for equal widths)."""
    lane = engine.program.layout.rows[1]
    layout = lanes.lay_out([lane], 1)
    single = engines.Engine(engines.make_program(tiny, layout, teachers))
    single_data = engines.lane_data(single.program, teachers, "train", [lane.damage])
    alone, _ = trained(single, single_data, 14)
    beside, _ = trained(engine, data, 14)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, atol=1e-4, rtol=1e-3),
        rows_of_lane(alone, single, 0)[1].actor,
        rows_of_lane(beside, engine, 1)[1].actor,
    )


def test_a_lane_that_is_not_finite_freezes_alone(engine, data):
    def poison(state):
        agent = state.agents["srl"]
        critic = jax.tree.map(lambda x: x.at[0].set(jnp.nan), agent.critic)
        agents = state.agents | {"srl": agent._replace(critic=critic)}
        return state._replace(agents=engines.on_rows(engine.program, agents))

    steps = 25  # not a multiple of the episode's 10: an auto-reset would hide a robot that was not frozen
    clean, _ = trained(engine, data, steps)
    state, tally = trained(engine, data, steps, poison)
    assert np.asarray(state.alive).tolist() == [True, False, True, True, True, True]
    for index in (0, 2, 3, 4, 5):
        assert_same(rows_of_lane(state, engine, index), rows_of_lane(clean, engine, index))
    assert np.isfinite(np.asarray(state.world.observation)).all()
    assert int(state.world.env.steps[1, 0]) != int(clean.world.env.steps[1, 0]), "the frozen robot still moves"
    actor = jax.tree.leaves(row(state.agents["srl"].actor, 0))
    assert all(np.isfinite(leaf).all() for leaf in actor), "the update that was not finite was kept"
    assert float(tally.steps[1]) < float(tally.steps[0])


def test_an_exploding_robot_freezes_its_lane_alone(engine, data):
    def explode(state):
        env = state.world.env
        qvel = env.qvel.at[2, 0, 0].set(jnp.inf)
        world = engines.on_rows(engine.program, state.world._replace(env=env._replace(qvel=qvel)))
        return state._replace(world=world)

    clean, _ = trained(engine, data, 12)
    state, _ = trained(engine, data, 12, explode)
    assert np.asarray(state.alive).tolist() == [True, True, False, True, True, True]
    assert np.asarray(state.world.env.steps[2]).tolist() == [0, 0], "the frozen robots still move"
    assert_same(rows_of_lane(state, engine, 3), rows_of_lane(clean, engine, 3))


def test_damage_changes_in_the_middle_without_another_program(engine, data, monkeypatch):
    state, _ = trained(engine, data, 4)
    monkeypatch.setattr(hexapod, "step", lambda *args: pytest.fail("traced again"))
    kept, _ = engine.chunk(jax.tree.map(jnp.copy, state), data, TRAIN(), 4)
    damaged = engines.with_damage(engine.program, data, ["leg_rm+leg_lf"] * 6)
    changed, _ = engine.chunk(state, damaged, TRAIN(), 4)
    assert np.abs(np.asarray(kept.world.env.qpos) - np.asarray(changed.world.env.qpos)).max() > 1e-3


def test_start_from_behaviour_gives_clones_and_healthy_replay(engine, data):
    state = start.init_state(engine, data)
    random = jax.device_get(state.agents)
    healthy = engines.with_damage(engine.program, data, ["healthy"] * 6)
    state, filled = start.from_behaviour(engine, state, data, healthy, network=False)
    assert int(state.clock) == 0
    assert np.all(np.abs(np.asarray(filled.prior["srl"])).sum(-1) > 0.0)
    assert_same(jax.device_get(state.agents["ddpg"]), random["ddpg"])
    assert_same(jax.device_get(state.agents["srl"].actor), jax.device_get(state.agents["srl"].target_actor))
    leaves = zip(jax.tree.leaves(state.agents["srl"].actor), jax.tree.leaves(random["srl"].actor), strict=True)
    assert any(not np.array_equal(a, b) for a, b in leaves)
