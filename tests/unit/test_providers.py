"""Which execution providers sessions get, and with which options."""

from pathlib import Path
from typing import Any

import onnxruntime as ort
import pytest

from app.network.providers import open_session


@pytest.mark.parametrize(("provider", "expected"), [
    ("auto", ["CUDAExecutionProvider", "CPUExecutionProvider"]), ("cpu", ["CPUExecutionProvider"])])
def test_cuda_multiplies_in_full_precision(provider: str, expected: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(ort, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(ort, "InferenceSession", lambda *_, providers, **__: asked.extend(providers))
    open_session(Path("network.onnx"), provider)
    assert [name for name, _ in asked] == expected
    assert all(options.get("use_tf32") == "0" for name, options in asked if name.startswith("CUDA"))
