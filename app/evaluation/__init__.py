"""Errors of pictures against path-traced references, and frame times."""
