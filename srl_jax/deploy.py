"""The door of ``python -m srl_jax.deploy``: a policy walks on the robot itself."""

from srl_jax.cli.deploy import main

if __name__ == "__main__":
    main()
