"""Agents as records of pure functions: init, act, student, update. They know no robot: a teacher is a function of s."""

from srl_jax.agents.registry import register

__all__ = ["register"]
