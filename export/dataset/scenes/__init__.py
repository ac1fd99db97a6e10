"""Generators of random scenes."""
