"""The robot itself: eighteen AX-12A on a serial bus, and a policy that walks on them at 20 Hz. Imports no jax.

`bus` speaks the servos' protocol, `servo` and `imu` give it units, `hexapod` makes one robot of them, `policy` says who
walks, `loop` when, and `safety` when not. `simulate` is a robot to try all of it on: another program, which answers
on a pseudo-terminal as servos do, with MuJoCo behind it.
"""
