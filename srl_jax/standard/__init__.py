"""The robot in the shapes of other people's libraries: `gym` for Gymnasium, `brax` for Brax and MuJoCo Playground.

Same tasks, rewards and ends as `srl_jax.env.hexapod`, step by step.
"""
