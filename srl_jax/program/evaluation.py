"""Episodes from fixed starts, by the same compiled program that trains."""

from collections.abc import Callable

import jax
import numpy as np

from srl_jax.program import tally as tallies
from srl_jax.program.engine import Engine
from srl_jax.program.state import LaneData, Mode, TrainState, on_all, on_rows
from srl_jax.program.tally import Tally


def evaluate(
    engine: Engine,
    state: TrainState,
    lanes: LaneData,
    mode: Mode,
    episodes: int,
    *,
    advance: Callable[..., tuple[TrainState, Tally]] | None = None,
) -> tuple[TrainState, Tally, np.ndarray]:
    """So many episodes of every lane from its first fixed starts; training's robots, clock and agents stay as they are.

    The program steps E robots a lane, so there are as many rounds as the episodes need; robots of the last round that
    are left over are not counted.

    Args:
        engine: the compiled program.
        state: donated.
        lanes: the rows, with the keys of the evaluation.
        mode: who acts.
        episodes: of each lane.
        advance: in place of ``engine.chunk``, for a caller that cuts it short.

    Returns:
        The state, the episodes' tally, and which lanes were finite throughout, bool[R].
    """
    program = engine.program
    steps, each = program.robot.config.episode_steps, program.environments
    clock, world, alive = jax.device_get(state.clock), state.world, np.asarray(state.alive)
    tally = tallies.empty(program)
    for first in range(0, episodes, each):
        state = state._replace(world=engine.new_world(lanes, first, episodes))
        state, tally = (advance or engine.chunk)(state, tally, lanes, mode, steps)
    finite = np.asarray(state.alive)
    return state._replace(clock=on_all(program, clock), world=world, alive=on_rows(program, alive)), tally, finite
