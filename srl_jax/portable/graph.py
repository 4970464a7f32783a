"""A policy as an ONNX graph, for runtimes in other languages and on other chips. Needs the extra `onnx`."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from srl_jax.portable.policy import EPSILON, Policy

OPSET = 17  # the first that has LayerNormalization
IR_VERSION = 8  # of the file: the oldest that has this opset, so that old runtimes read it


def save(path: Path, policy: Policy) -> None:
    """Writes one policy as .onnx, all of the file or nothing of it.

    Its input is `observation` f32[batch, O], its output `action` f32[batch, A]; its metadata are what the policy is
    about, texts as they are and the rest as JSON.

    Raises:
        ValueError: onnx is not installed.
    """
    partial = path.with_suffix(".partial")
    partial.write_bytes(_model(policy).SerializeToString())
    partial.replace(path)


def _model(policy: Policy) -> Any:
    try:
        import onnx
        from onnx import TensorProto, helper, numpy_helper
    except ModuleNotFoundError:
        raise ValueError("format is 'onnx', which needs the extra: pip install 'srl-jax[onnx]'.") from None
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])
        for name, size in (("observation", policy.observation_size), ("action", policy.action_size))
    ]
    weights = [numpy_helper.from_array(np.ascontiguousarray(x), name) for name, x in policy.weights.items()]
    nodes = [helper.make_node(kind, inputs, [output], **more) for kind, inputs, output, more in _nodes(policy)]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    model.producer_name = "srl_jax"
    said = {key: value if isinstance(value, str) else json.dumps(value) for key, value in policy.about.items()}
    helper.set_model_props(model, said)
    onnx.checker.check_model(model, full_check=True)
    return model


def _nodes(policy: Policy) -> Iterator[tuple[str, list[str], str, dict[str, Any]]]:
    """Operators, what each reads, what it is called, and its attributes."""
    last, x = len(policy.layers) - 1, "observation"
    for number, layer in enumerate(policy.layers):
        yield "Gemm", [x, f"{number}/kernel", f"{number}/bias"], f"{number}/dense", {}
        x = f"{number}/dense"
        if layer.scale is not None and number < last:
            read = [x, f"{number}/scale", f"{number}/shift"]
            x = f"{number}/norm"
            yield "LayerNormalization", read, x, {"epsilon": EPSILON}
        output = "action" if number == last else f"{number}/relu"
        yield "Tanh" if number == last else "Relu", [x], output, {}
        x = output
