"""Compares models on validation views, along camera paths and under environments."""
