"""Agents as triples of pure functions: init, act, update. They know no robot: a teacher is a function of s."""
