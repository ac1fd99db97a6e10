"""Afterglow: a real-time OpenGL renderer whose indirect light an ONNX network infers."""

__version__ = "0.1.0"
