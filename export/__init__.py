"""Everything that needs torch: networks and their way into ONNX. The renderer never imports it."""
