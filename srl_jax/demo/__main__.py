"""The door of ``python -m srl_jax.demo``: a page in which a visitor cuts off a leg."""

from srl_jax.cli.demo import main

if __name__ == "__main__":
    main()
