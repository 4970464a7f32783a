"""The door of ``python -m srl_jax.run``: training."""

from srl_jax.cli.run import main

if __name__ == "__main__":
    main()
