"""The door of ``python -m srl_jax.recover``: one robot that is damaged in mid-stride and walks on."""

from srl_jax.cli.recover import main

if __name__ == "__main__":
    main()
