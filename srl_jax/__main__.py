"""The door of ``python -m srl_jax``: the one command, as ``srl-jax``."""

from srl_jax.cli.main import main

if __name__ == "__main__":
    main()
