"""Networks as the renderer sees them: channels, contracts, onnxruntime sessions, and which model does what."""
