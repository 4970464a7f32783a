"""A package of somebody else: an algorithm that holds one joint still, and the command line with it.

    python -m tests.job.still OUT WORDS...

runs by the words, then prints what a resume of the run would read and what its lanes have learned.
"""

import dataclasses
import json
import sys
from pathlib import Path
from typing import NamedTuple

import srl_jax.agents
from srl_jax.agents.sweep import AgentSettings, Count, NotNegative
from srl_jax.cli import run


@dataclasses.dataclass(frozen=True)
class StillSettings(AgentSettings):
    """Where a joint is held."""

    size: NotNegative = (0.5,)
    """Action of the joint."""
    joint: Count = 1
    """Its number, from 1."""


class StillState(NamedTuple):
    actor: dict
    critic: tuple = ()


def make(settings: StillSettings):
    import jax.numpy as jnp

    from srl_jax.agents.interface import Agent

    def init(key, observation_size, action_size, *, teachers=()):
        return StillState({"rest": jnp.zeros(action_size)})

    def student(actor, observation, *, teachers=()):
        return actor["rest"].at[settings.joint - 1].set(0.25)

    def act(state, act_state, observation, key, *, hyper, step, teachers=()):
        return state.actor["rest"].at[settings.joint - 1].set(hyper.size), act_state

    return Agent(init=init, act=act, student=student)


def main(out: str, words: list[str]) -> None:
    srl_jax.agents.register("still", StillSettings(), make)
    try:
        run.main(["--out", out, *words])
    except SystemExit as ended:
        if ended.code:
            raise
    config = run.parse(["--resume", out])[1]

    import jax.numpy as jnp

    from srl_jax.job.students import open_run

    learned = open_run(Path(out))
    seen = jnp.zeros(learned.program.observation_size)
    actions = [learned.policy(lane)(seen).tolist() for lane in learned.lanes_of("still")]
    print(json.dumps({"more": {k: dataclasses.asdict(v) for k, v in config.more.items()}, "actions": actions}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
