"""The door of ``python -m srl_jax.atlas``: a policy for every damage, made before any happens."""

from srl_jax.cli.atlas import main

if __name__ == "__main__":
    main()
