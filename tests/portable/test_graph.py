"""A policy as an ONNX graph: another runtime gives the same actions and finds what it is about."""

import json
import sys

import numpy as np
import pytest

from srl_jax.portable import graph
from tests.portable.made import policy


@pytest.mark.parametrize("layer_norm", [True, False])
def test_another_runtime_acts_alike(layer_norm, tmp_path):
    import onnxruntime

    own = policy(layer_norm, seed=3, task="x")
    graph.save(tmp_path / "own.onnx", own)
    session = onnxruntime.InferenceSession(tmp_path / "own.onnx", providers=["CPUExecutionProvider"])
    seen = np.random.default_rng(0).normal(size=(50, 7)).astype(np.float32)
    np.testing.assert_allclose(session.run(["action"], {"observation": seen})[0], own(seen), atol=1e-5)
    np.testing.assert_allclose(session.run(None, {"observation": seen[:1]})[0], own(seen[:1]), atol=1e-5)
    said = session.get_modelmeta().custom_metadata_map
    assert said["task"] == "x" and json.loads(said["observation"]) == [["clock", 2], ["joints", 5]]
    assert json.loads(said["seed"]) == 3


def test_without_onnx_there_is_a_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ValueError, match=r"needs the extra: pip install 'srl-jax\[onnx\]'"):
        graph.save(tmp_path / "own.onnx", policy())
    assert not list(tmp_path.iterdir())
