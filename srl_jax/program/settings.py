"""The settings of the compiled program. Imports no jax, so that ``--help`` answers at once."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrainConfig:
    """How lanes collect and learn; one clock shared by all of them. Steps are environment steps of one lane."""

    environments: int = 10
    """Environments a lane steps at once."""
    capacity: int = 50_000
    """Transitions a lane's replay holds."""
    warmup: int = 1_000
    """Environment steps before the first update."""
    update_every: int = 2
    """Vector steps (of `environments` environment steps) from one turn of learning to the next."""
    updates: int = 1
    """Updates of the agents at each turn, each from mini-batches of its own."""
    evaluate_every: int = 5_000
    """Environment steps between two evaluations of the student alone."""
    checkpoint_every: int = 25_000
    """Environment steps between two checkpoints (a multiple of evaluate_every)."""
    prior_steps: int = 2_400
    """Healthy transitions of pi_B collected for cloning and for the prior replay."""
    clone_updates: int = 1_000
    """Gradient steps of behaviour cloning where the student starts from a scripted pi_B."""
    physics_block: int = 6
    """Lanes whose physics MJX steps together on a CPU (cache-sized); 0: all at once. The star stepper ignores it."""
    update_block: int = 4
    """Lanes that learn together on a CPU (cache-sized); 0: all at once, as on a GPU."""

    @property
    def steps_an_update(self) -> float:
        """Environment steps of a lane to one update of its agent."""
        return self.environments * self.update_every / self.updates


@dataclass(frozen=True)
class EvaluationConfig:
    """How students are judged: alone, without noise, from starts that are the same in every evaluation."""

    episodes: int = 10
    """Episodes of each lane; the i-th start depends on seed and damage, not on how many environments train."""
