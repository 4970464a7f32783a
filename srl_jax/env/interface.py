"""What goes into the robot and what comes out of it, for whoever has a policy and no simulation. Imports no jax."""

from typing import Any

from srl_jax.env.anatomy import JOINTS, LEGS

CONTROL_HZ = 20.0
SUBSTEPS = 3  # of 1/60 s
ACTION_SIZE = len(JOINTS)
ACTION_SCALE = (0.6, 0.7, 0.7)  # rad of coxa, femur, tibia about the stance at action 1
STANCE = (0.0, 0.3403, -1.5621)  # rad of coxa, femur, tibia: the keyframe of the robot's description
RANGE = (75.0, 100.0, 150.0)  # degrees to either side of coxa, femur, tibia's zero, as there


def layout(task: str, kind: str, history: int = 0) -> list[tuple[str, int]]:
    """What an observation is made of, in order: names and sizes; see `senses.observation`."""
    parts = [("clock: sin, cos", 2), ("direction: ahead, left", 2)]
    if task == "p2p":
        parts.append(("distance, m, at most 2", 1))
    parts += [("gravity in the body frame", 3), ("joint angles about the stance, rad", len(JOINTS))]
    if kind == "full":
        parts.append(("velocity of the base in the body frame, m/s", 3))
    if kind != "onboard":
        parts += [("0.3 x gyroscope, rad/s", 3), ("0.1 x joint speeds, rad/s", len(JOINTS))]
    if kind == "full":
        parts.append(("10 x height, m", 1))
    if history:
        row = reading_size(kind) + ACTION_SIZE
        parts.append((f"what was sensed and done in each of {history} control steps before", history * row))
    return parts


def reading_size(kind: str) -> int:
    """Numbers of what is sensed of the body in an observation, see `senses.reading`."""
    more = {"onboard": 0, "rates": 3 + ACTION_SIZE, "full": 3 + 3 + ACTION_SIZE + 1}
    return 3 + ACTION_SIZE + more[kind]


def facts(task: str, kind: str, clock_hz: float, history: int = 0) -> dict[str, Any]:
    """What a policy needs to be run elsewhere, as `portable.Policy.about` has it."""
    return {
        "task": task,
        "kind": kind,
        "history": history,
        "observation": layout(task, kind, history),
        "action_scale": list(ACTION_SCALE) * len(LEGS),
        "clock_hz": float(clock_hz),
        "control_hz": CONTROL_HZ,
    }
