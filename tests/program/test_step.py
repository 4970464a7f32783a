"""The compiled chunk: what it stores and leaves alone; rows do not touch each other; one program serves all."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import hexapod
from srl_jax.job import start
from srl_jax.program import engine as engines
from srl_jax.program import tally as tallies
from srl_jax.program.lanes import lay_out
from srl_jax.program.randomness import per_robot
from srl_jax.program.state import REFERENCE, STUDENT, TEACHER, TRAIN, on_rows, tuned_gait
from tests.program.rows import assert_same, row, rows_of_lane

E = 2
ROWS = 12  # two of each algorithm on each of two devices
DDPG, SRL, BPG = (0, 1, 6, 7), (2, 3, 8, 9), (4, 5, 10, 11)


def test_layout_has_every_algorithm_on_every_device(engine):
    assert [lane.algo for lane in engine.program.layout.rows] == ["ddpg", "ddpg", "srl", "srl", "bpg", "bpg"] * 2


def test_transitions_are_stored_in_order_and_chain(engine, data, tiny, trained):
    state, _ = trained(data, 12)
    assert set(state.replay) == {"ddpg", "srl"}, "a search from episodes replays nothing"
    assert int(state.clock) == 12 * E
    assert np.all(np.asarray(state.replay["srl"].moves)[:, 12:] == 0.0)
    rows = start.first_steps(engine.program, "srl", state, 12 * E)
    assert np.all(np.abs(rows.action) <= 1.0)
    # Robot 0 of a lane fills every E-th row; within an episode of 10 steps each step starts where the last ended.
    first = jax.tree.map(lambda x: x[:, : 10 * E : E], rows)
    np.testing.assert_array_equal(first.next_observation[:, :-1], first.observation[:, 1:])
    # The 11th step starts anew, but what the 10th reached was stored as it was before the reset.
    tenth, eleventh = rows.next_observation[:, 9 * E], rows.observation[:, 10 * E]
    assert np.abs(tenth - eleventh).max(axis=1).min() > 1e-3


def test_every_transition_has_a_lot_of_its_own(engine, data, tiny, trained):
    state, _ = trained(data, 12)
    lots = np.asarray(start.first_steps(engine.program, "ddpg", state, 12 * E).lot)
    assert np.all(lots == np.floor(lots)) and lots.min() >= 0 and lots.max() < 2**24
    assert len(np.unique(lots)) == lots.size


def test_ring_wraps(engine, data, tiny, trained):
    few, _ = trained(data, 4)
    before = np.asarray(few.replay["ddpg"].moves)[:, 0].copy()
    state, _ = trained(data, tiny.train.capacity // E + 1)
    after = np.asarray(state.replay["ddpg"].moves)
    assert int(state.clock) == tiny.train.capacity + E
    assert not np.array_equal(after[:, 0], before)
    assert np.all(np.abs(after).sum(-1) > 0.0)


def test_agents_learn_only_when_asked(engine, data, trained, fresh):
    unmoved = jax.device_get(fresh().agents)
    idle, _ = trained(data, 20, mode=STUDENT())
    assert_same(jax.device_get(idle.agents), unmoved)
    assert np.all(np.asarray(idle.replay["srl"].moves) == 0.0)
    busy, tally = trained(data, 20)
    assert float(tally.updates) == 7  # at every other step, from the 8th on, which fills the warm-up of 16
    for algo in ("ddpg", "srl"):
        for name in ("actor", "critic", "target_actor", "target_critic"):
            new, old = getattr(busy.agents[algo], name), getattr(unmoved[algo], name)
            moved = jax.tree.map(lambda n, o: np.abs(np.asarray(n) - o).max(), new, old)
            assert max(jax.tree.leaves(moved)) > 0.0, (algo, name)


def test_a_search_counts_finished_episodes_and_takes_a_step_when_there_are_enough(engine, data, trained):
    ten, _ = trained(data, 10)  # the first episodes of both robots end, whether they fell or not
    searches = jax.device_get(ten.agents["bpg"])
    assert np.all(searches.count == 0) and np.all(searches.since > 0)
    assert np.all(np.abs(searches.actor["offset"]).max(1) > 0.0)
    watched, tally = trained(data, 10, mode=STUDENT())
    assert np.all(jax.device_get(watched.agents["bpg"].since) == 0), "an evaluation is no trial"
    trained_, tally = trained(data, 12)
    chosen = {name: np.asarray(tally.rates[name]) for name in ("chosen_teacher", "chosen_1", "chosen_2")}
    np.testing.assert_allclose(chosen["chosen_teacher"], chosen["chosen_1"] + chosen["chosen_2"])
    assert chosen["chosen_teacher"][list(SRL)].sum() > 0.0, "SRL never took a teacher"
    assert np.all(np.asarray(trained_.alive))


def test_teacher_and_reference_act_as_the_gait(engine, data, fresh):
    before = row(fresh().world.observation, 0)
    robot = engine.program.robot
    damage = jax.tree.map(lambda x: x[0], data.damage)
    env, _ = hexapod.reset(robot, damage, per_robot(data.key, 0, E)[0, 0])
    action = tuned_gait()(jnp.asarray(before[0]))
    env, step = jax.jit(lambda d, e, a: hexapod.step(robot, d, e, a))(damage, env, action)
    for mode in (TEACHER, REFERENCE):
        after, _ = engine.chunk(fresh(), tallies.empty(engine.program), data, mode(), 1)
        np.testing.assert_allclose(row(after.world.observation, 0)[0], step.observation, atol=1e-4)


def test_how_steps_are_cut_into_chunks_changes_no_digit(engine, data, trained):
    whole = trained(data, 24)
    state, tally = trained(data, 5)
    for steps in (1, 11, 7):
        state, tally = engine.chunk(state, tally, data, TRAIN(), steps)
    assert_same(jax.device_get((state, tally)), jax.device_get(whole))


def test_a_row_does_not_depend_on_its_neighbours(engine, data, trained):
    base, _ = trained(data, 20)
    others = data.key.at[1:].set(jax.random.split(jax.random.key(99), len(data.key) - 1))
    names = ["leg_rm", "leg_lf", "healthy", "tibia_rr:limp", "leg_rf", "leg_lr"] * 2
    damage = engines.damage_rows(names)
    changed = on_rows(engine.program, data._replace(key=others, damage=damage))
    other, _ = trained(changed, 20)
    assert_same(rows_of_lane(base, engine, 0), rows_of_lane(other, engine, 0))
    assert not np.array_equal(row(base.world.observation, 1), row(other.world.observation, 1))


@pytest.mark.slow
def test_a_row_does_not_depend_on_width_nor_on_blocks(engine, data, tiny, teachers, trained, fresh):
    """Alone on one device, as on an accelerator: other widths round differently; bitwise is for equal widths."""
    lane = engine.program.layout.rows[2]
    program = start.make_program(tiny, lay_out([lane], 1), teachers)
    single = engines.Engine(dataclasses.replace(program, wide=True))
    alone_data = start.make_lanes(single.program, tiny, teachers, "train", [lane.damage])
    steps = 13  # the actor's first two steps; before, nothing has moved
    alone, _ = single.chunk(
        start.init_state(single, alone_data), tallies.empty(single.program), alone_data, TRAIN(), steps
    )
    beside, _ = trained(data, steps)
    began = jax.tree.leaves(row(fresh().agents["srl"].actor, 0))
    left, right = (jax.tree.leaves(row(x.agents["srl"].actor, 0)) for x in (alone, beside))
    for a, b, old in zip(left, right, began, strict=True):
        moved = np.abs(b - old).max()
        assert moved > 0.0
        np.testing.assert_allclose(a - old, b - old, atol=0.05 * moved)


def test_a_lane_that_is_not_finite_freezes_alone(engine, data, trained):
    def poison(state):
        agent = state.agents["srl"]
        critic = jax.tree.map(lambda x: x.at[0].set(jnp.nan), agent.critic)
        agents = state.agents | {"srl": agent._replace(critic=critic)}
        return state._replace(agents=on_rows(engine.program, agents))

    steps = 25  # not a multiple of the episode's 10: an auto-reset would hide a robot that was not frozen
    clean, _ = trained(data, steps)
    state, tally = trained(data, steps, poison)
    sick = SRL[0]
    assert np.flatnonzero(~np.asarray(state.alive)).tolist() == [sick]
    for index in set(range(ROWS)) - {sick}:
        assert_same(rows_of_lane(state, engine, index), rows_of_lane(clean, engine, index))
    assert np.isfinite(np.asarray(state.world.observation)).all()
    assert int(state.world.env.steps[sick, 0]) != int(clean.world.env.steps[sick, 0]), "the frozen robot still moves"
    actor = jax.tree.leaves(row(state.agents["srl"].actor, 0))
    assert all(np.isfinite(leaf).all() for leaf in actor), "the update that was not finite was kept"
    assert float(tally.steps[sick]) < float(tally.steps[0])


def explode(engine, index):
    """Gives the first robot of a row an infinite speed."""

    def edit(state):
        env = state.world.env
        qvel = env.qvel.at[index, 0, 0].set(jnp.inf)
        world = on_rows(engine.program, state.world._replace(env=env._replace(qvel=qvel)))
        return state._replace(world=world)

    return edit


def test_an_exploding_robot_freezes_its_lane_alone(engine, data, trained):
    sick = BPG[0]
    clean, _ = trained(data, 12)
    state, _ = trained(data, 12, explode(engine, sick))
    assert np.flatnonzero(~np.asarray(state.alive)).tolist() == [sick]
    assert np.asarray(state.world.env.steps[sick]).tolist() == [0, 0], "the frozen robots still move"
    assert_same(rows_of_lane(state, engine, sick + 1), rows_of_lane(clean, engine, sick + 1))


def test_damage_changes_in_the_middle_without_another_program(engine, data, trained, monkeypatch):
    state, tally = trained(data, 4)
    # Whatever would lower or trace the chunk again goes through here.
    monkeypatch.setattr(engine, "_chunk", None)
    kept, _ = engine.chunk(*jax.tree.map(jnp.copy, (state, tally)), data, TRAIN(), 4)
    damaged = engines.with_damage(engine.program, data, ["leg_rm+leg_lf"] * ROWS)
    changed, _ = engine.chunk(state, tally, damaged, TRAIN(), 4)
    assert np.abs(np.asarray(kept.world.env.qpos) - np.asarray(changed.world.env.qpos)).max() > 1e-3
