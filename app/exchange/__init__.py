"""How the tensors of a network get from OpenGL to onnxruntime and back: by copies, by mapped memory, by CUDA."""
