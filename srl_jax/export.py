"""The door of ``python -m srl_jax.export``: policies to take home, as .npz, .json or .onnx."""

from srl_jax.cli.export import main

if __name__ == "__main__":
    main()
