"""A stepper for star-shaped robots: MJX's results at ten times its speed on a CPU (docs/physics.md)."""

from srl_jax.env.star.batching import simulate
from srl_jax.env.star.constants import Star, read
from srl_jax.env.star.refusals import NotAStarError
from srl_jax.env.star.stepper import State

__all__ = ["NotAStarError", "Star", "State", "read", "simulate"]
