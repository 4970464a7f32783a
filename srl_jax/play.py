"""The door of ``python -m srl_jax.play``: a robot is damaged in mid-stride, and a policy walks on."""

from srl_jax.cli.play import main

if __name__ == "__main__":
    main()
