"""Rays through a scene with moving bodies, by Embree on the CPU."""
