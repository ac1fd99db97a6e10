"""Torch networks to ONNX files, and checks of what comes out."""
