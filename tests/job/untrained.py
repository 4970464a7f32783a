"""Directories of runs that never ran: what their agents know is what they began with, or a little beside it."""

import jax
import jax.numpy as jnp

from srl_jax.job import checkpoint, files, plan, start
from srl_jax.job.teachers import scripted_gait
from srl_jax.program import tally
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import TrainState
from tests.conftest import DEVICES


def write(config, directory, lanes=None, teachers=None):
    """The settings and the checkpoint of a run, of some of its lanes where it is a wave; lane -> its actor.

    A search begins at pi_B whatever its seed, so every lane's is moved by another amount.
    """
    lanes = plan.make(config).lanes if lanes is None else lanes
    teachers = teachers or (scripted_gait(config.anatomy),) * len(plan.parse_teachers(config))
    program = start.make_program(config, lay_out(lanes, DEVICES), teachers)
    damages = plan.make(config).damages(program.layout.rows, 0)
    data = start.make_lanes(program, config, teachers, "train", damages)
    agents = start.init_agents(program, data)
    if "bpg" in agents:
        numbers = jnp.array([lane.index for lane in program.layout.of("bpg")])
        moved = agents["bpg"].actor["offset"] + 0.01 * numbers[:, None]
        agents["bpg"] = agents["bpg"]._replace(actor={"offset": moved})
    rows = jnp.zeros(len(program.layout.rows))
    state = TrainState(jnp.zeros((), jnp.int32), agents, {}, rows, rows)
    directory.mkdir(parents=True, exist_ok=True)
    files.write_config(directory, config, DEVICES)
    with checkpoint.manager(directory / "checkpoints") as keeper:
        checkpoint.save(keeper, program, state, data._replace(prior={}), tally.empty(program), {}, last=True)
    actors = {}
    for algo in program.layout.algos:
        for row, lane in enumerate(program.layout.of(algo)):
            actors[lane.index] = jax.tree.map(lambda x, row=row: x[row], agents[algo].actor)
    return actors
