"""The path tracer that references come from."""
