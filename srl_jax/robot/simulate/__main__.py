"""The door of ``python -m srl_jax.robot.simulate``: a robot to talk to, on a pseudo-terminal."""

from srl_jax.cli.simulate import main

if __name__ == "__main__":
    main()
