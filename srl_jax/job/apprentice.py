"""SRL in the twin: what a robot learns for a damage in its own simulation, while it walks on by what it knows.

One lane of the ordinary training program, with one damage and pi_B, the policy that it walks by, as values: compiled
once, before anything breaks, it serves every damage. It costs computing, and no robot time.
"""

import dataclasses
from collections.abc import Iterator
from functools import partial

import jax
import jax.numpy as jnp

from srl_jax.agents import behaviour as behaviours
from srl_jax.atlas.file import Atlas
from srl_jax.config import Config, preset, taking_over
from srl_jax.job import start
from srl_jax.job.teachers import Behaviour
from srl_jax.program import tally as tallies
from srl_jax.program.engine import Engine, lane_data
from srl_jax.program.lanes import Lane, lay_out
from srl_jax.program.state import TRAIN, on_rows
from srl_jax.types import Params

ALGO = "srl"


def configured(atlas: Atlas, base: Config | None = None) -> Config:
    """The run that one lesson is: SRL on the atlas' task and senses, guided by a policy of the atlas."""
    how = taking_over(base or preset("default"), atlas.about["task"], atlas.about["observation"])
    network = dict(hidden=atlas.network.hidden, layer_norm=atlas.network.layer_norm)
    return dataclasses.replace(how, srl=dataclasses.replace(how.srl, **network))


class Apprentice:
    """Learns policies for damages that an atlas lacks; what is compiled for the first serves all."""

    def __init__(self, atlas: Atlas, base: Config | None = None):
        self.config = configured(atlas, base)
        self.atlas = atlas
        apply = partial(behaviours.policy, config=atlas.network)
        nothing = lambda lanes: jax.tree.map(lambda leaf: leaf[:1], atlas.actors)  # noqa: E731
        pi_b = Behaviour(apply, nothing, float(atlas.about["clock_hz"]), atlas.network.architecture)
        layout = lay_out([Lane(0, ALGO, 0, self.config.task, "any")], 1)
        self.engine = Engine(start.make_program(self.config, layout, [pi_b]))

    def learn(self, damage: str, policy: Params, stages: tuple[int, ...]) -> Iterator[Params]:
        """Actors of ever more training for one damage.

        Args:
            damage: its name.
            policy: an actor of the atlas, or one learned before: where learning starts, and pi_B.
            stages: environment steps after which an actor is given out, rising.
        """
        program = self.engine.program
        own = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], policy)
        lanes = lane_data(program, {ALGO: self.config.srl}, [lambda rows: own], "train", [damage])
        state, tally = start.init_state(self.engine, lanes), tallies.empty(program)
        adopt = program.agents[ALGO].adopt
        assert adopt is not None
        agent = adopt(state.agents[ALGO], on_rows(program, jax.tree.map(jnp.copy, own)))
        state = state._replace(agents={ALGO: agent})
        before = 0
        for steps in stages:
            count = (steps - before) // program.environments
            state, tally = self.engine.chunk(state, tally, lanes, TRAIN(), count)
            before += count * program.environments
            yield jax.device_get(jax.tree.map(lambda leaf: leaf[0], state.agents[ALGO].actor))
