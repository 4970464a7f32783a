"""Policies to take home: observation -> action by NumPy alone, in files without pickle. Imports no jax.

A file says what a policy needs to be run elsewhere: its task, what its observation is made of, by what its action is
scaled, the frequency of its clock, and what made it.
"""

from srl_jax.portable.files import load, save
from srl_jax.portable.policy import WEIGHTS, Layer, Policy, pick, rounded

__all__ = ["WEIGHTS", "Layer", "Policy", "load", "pick", "rounded", "save"]
