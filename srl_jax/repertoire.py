"""The door of ``python -m srl_jax.repertoire``: a map of gaits, made before any damage."""

from srl_jax.cli.repertoire import main

if __name__ == "__main__":
    main()
