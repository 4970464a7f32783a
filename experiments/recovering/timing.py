"""How long what a robot computes takes: within a control step, between two of them, and beside its walking."""

from collections.abc import Callable
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.atlas import lessons, recovery, suspects
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.robots import CRobot
from srl_jax.env import damage as damages
from srl_jax.job.apprentice import Apprentice

STEPS, REPEATS = 100, 7
READY = (200,)  # environment steps of the lesson that compiles


def report(atlas: Atlas, course: lessons.Course = lessons.COURSE) -> str:
    """Seconds, compiling apart: medians of control steps, the least of some repeats otherwise."""
    mind, known = recovery.mind_of(atlas), recovery.knowledge(atlas)
    scopes = recovery._stacked([recovery.scope(atlas)])
    body, recorder, taken = CRobot(atlas.damages[1], STEPS // 2), suspects.Recorder(), []
    senses = body.reset()
    memory = recovery._begin(known, scopes, jax.random.split(jax.random.key(0), 1), mind=mind)
    for _ in range(STEPS):
        began = perf_counter()
        felt = recovery._stacked([senses])
        memory = recovery._think(known, scopes, memory, felt, mind=mind)
        action = np.asarray(memory.action[0])
        taken.append(perf_counter() - began)
        senses = body.step(action)
        recorder.add(action, senses)
    own, log = jax.tree.map(jnp.asarray, damages.build("leg_rm+leg_lf")), recorder.log()
    many = suspects._stacked(["leg_rm"])
    parts = {
        "a control step": float(np.median(taken[1:])),
        "all policies in a new simulation": _least(
            lambda: recovery._imagine(known, known.actors, own, mind=mind),
        ),
        f"{suspects.ROOM} suppositions": _least(lambda: recovery._explain(known, many, log, mind=mind)),
        "thinking again": _least(lambda: recovery._again(known, scopes, memory, felt, 0, mind=mind)),
        **_lessons(atlas, course),
    }
    return ", ".join(f"{name} {seconds:.2g} s" for name, seconds in parts.items())


def _least(call: Callable) -> float:
    jax.block_until_ready(call())
    found = []
    for _ in range(REPEATS):
        began = perf_counter()
        jax.block_until_ready(call())
        found.append(perf_counter() - began)
    return min(found)


def _lessons(atlas: Atlas, course: lessons.Course) -> dict[str, float]:
    apprentice, policy = Apprentice(atlas), jax.tree.map(lambda leaf: leaf[0], atlas.actors)
    began = perf_counter()
    list(apprentice.learn(atlas.damages[1], policy, READY))
    found, began = {"making lessons ready": perf_counter() - began}, perf_counter()
    for steps, _ in zip(course.steps, apprentice.learn(atlas.damages[-1], policy, course.steps), strict=True):
        found[f"a lesson of {steps:,} steps"] = perf_counter() - began
    return found
