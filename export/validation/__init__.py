"""Judging networks: validation views, camera paths, environments."""
