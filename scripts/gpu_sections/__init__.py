"""The sections of ``measure_gpu.py``: each measures one thing and returns what JSON can hold."""
