"""Poses of animated scenes at any time: tracks of keys, trees of nodes, skins and morph targets."""
