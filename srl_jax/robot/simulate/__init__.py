"""A robot to try the loop on: eighteen simulated AX-12A and an inertial unit, with C MuJoCo behind them.

`terminal` puts them behind pseudo-terminals, in real time, for ``python -m srl_jax.robot.simulate``; `wire` into the
program itself, in lock-step. Only `body` needs MuJoCo, and imports it when a robot is made.
"""
