"""A course of learning on a robot: what is learned, from what, and where it is kept. Imports no jax."""

import dataclasses
from pathlib import Path
from typing import Any

from srl_jax.agents.settings import ActorConfig
from srl_jax.agents.sweep import AgentSettings
from srl_jax.config import preset
from srl_jax.env.settings import EnvConfig
from srl_jax.portable import Policy
from srl_jax.program.settings import TrainConfig
from srl_jax.robot.student import Exploration

ALGOS = ("srl", "ddpg_warm")  # those that start from a policy
STATE, STUDENT, EPISODES = "state.npz", "student.npz", "episodes"
SAVE_EVERY = 100  # steps: five seconds


@dataclasses.dataclass(frozen=True)
class Course:
    """What is learned, and from what."""

    policy: Policy  # pi_B, and where the student starts
    directory: Path  # of its files
    algo: str = "srl"
    updates: int = 2  # a control step, as time allows
    seed: int = 0
    resume: bool = False

    @property
    def about(self) -> dict[str, Any]:
        """What a course that goes on must have in common with its beginning."""
        return {"algo": self.algo, "updates": self.updates, "seed": self.seed}

    @property
    def exploration(self) -> Exploration:
        """The noise of its student."""
        agent = settings(self)[0]
        assert isinstance(agent, ActorConfig)
        return Exploration(agent.noise[0], agent.noise_correlation[0], self.seed)


def settings(course: Course) -> tuple[AgentSettings, EnvConfig, TrainConfig]:
    """Those of the preset ``robot``, for a network such as the policy's."""
    base = preset("robot")
    hidden = tuple(layer.kernel.shape[1] for layer in course.policy.layers[:-1])
    norm = course.policy.layers[0].scale is not None
    agent = dataclasses.replace(base.agent(course.algo), hidden=hidden, layer_norm=norm)  # type: ignore[call-arg]
    return agent, base.env, base.train
