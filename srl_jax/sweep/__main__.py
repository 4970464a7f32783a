"""The door of ``python -m srl_jax.sweep``: many runs, on one machine or many."""

from srl_jax.cli.sweep import main

if __name__ == "__main__":
    main()
