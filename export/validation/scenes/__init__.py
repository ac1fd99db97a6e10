"""Generators of the validation scenes that emissive surfaces light; no dataset uses them."""
