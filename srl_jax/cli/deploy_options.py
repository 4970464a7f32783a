"""What ``deploy`` is asked for."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from srl_jax.env import damage_names


@dataclass(frozen=True)
class Arguments:
    """Walk on the robot itself: stand up joint by joint, walk straight ahead, lie down. Ctrl-C makes it lie down; a
    second one lets it go at once."""

    policy: Annotated[str, tyro.conf.Positional] = "atlas"
    """atlas (which ships), the directory of a finished run, or a file of python -m srl_jax.export (.npz, .json)."""
    port: str = ""
    """Of the servos' adapter, such as /dev/ttyUSB0."""
    simulate: bool = False
    """Instead of a port, a simulated robot: python -m srl_jax.robot.simulate."""
    imu: str = ""
    """Port of the inertial unit, such as /dev/ttyACM0; none: the robot is taken to be level, and may tip unnoticed."""
    imu_axes: str = "x,y,z"
    """The unit's axes that point ahead, to the left and up, such as -y,x,z."""
    seconds: float = 20.0
    """Of walking."""
    trained_for: str = damage_names.HEALTHY
    """The damage whose policy walks first."""
    switch: bool = True
    """Where servos fall silent, go on by the policy for what is lost, if there is one."""
    algo: str = ""
    """Of a run or file that has several; empty: srl where there is one."""
    torque: float = 1.0
    """Share of a servo's torque that it may use; .4 is enough on a stand."""
    calibration: str = ""
    """JSON of joints that differ from the kit: {"tibia_rf": {"zero": 498, "sign": -1}}."""
    log: str = "walk.jsonl"
    """What is left of the walk, a line a step."""
    learn: bool = False
    """Learn while it walks, in episodes; Enter ends an episode. With --algo srl (the default) or ddpg_warm."""
    behaviour: str = ""
    """With --learn: the policy that it starts from and is guided by, as POLICY; empty: POLICY."""
    odometer: str = ""
    """With --learn and --port: where lines that say how far it has come are read; a simulated robot has its own."""
    episode: float = 5.0
    """With --learn: seconds after which it takes the stance anew."""
    updates: int = 2
    """With --learn: of the networks, a control step at most, as time allows."""
    out: str = "learned"
    """With --learn: a directory for what it learns, saved every five seconds."""
    resume: str = ""
    """With --learn: such a directory, to go on from; --seconds counts what was walked before."""
    seed: int = 0
    """With --learn: of noise, batches and networks."""
    dry_run: bool = False
    """Write nothing to the servos; print what would be sent."""
    damage: str = damage_names.HEALTHY
    """With --simulate: what the robot loses, such as leg_rm."""
    strike: float = 5.0
    """With --simulate: after so many seconds of walking; 0: it has it from the start."""
    faults: str = ""
    """With --simulate: shares of packets that go wrong, such as drop=.02,corrupt=.01,late=.05."""
