"""The door of ``python -m srl_jax.report``: the page of a run, or of several side by side."""

from srl_jax.cli.report import main

if __name__ == "__main__":
    main()
