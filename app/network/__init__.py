"""Networks: channels, contracts, onnxruntime sessions, and the selection of models."""
