"""Checks that all numbers of a scene are finite and in range."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from app.scene import EmissionImage, Scene

NON_NEGATIVE = ("intensity", "irradiance", "radiance", "radius", "angular_radius_deg")


def find_invalid(scene: Scene) -> list[str]:
    """Names of values that are not finite or out of range."""
    return [name for name, values, low, high in _numbers(scene)
            if not (np.isfinite(values).all() and np.all(values >= low) and np.all(values <= high))]


def _numbers(scene: Scene) -> Iterator[tuple[str, Any, float, float]]:
    """Name, values, minimum and maximum of all numeric data."""
    inf = np.inf
    yield "bounds", scene.bounds, -inf, inf
    for mesh in scene.meshes:
        yield "positions", mesh.positions, -inf, inf
        yield "normals", mesh.normals, -1.001, 1.001
        yield "uvs", np.zeros(1) if mesh.uvs is None else mesh.uvs, -inf, inf
        yield "second uvs", np.zeros(1) if mesh.second_uvs is None else mesh.second_uvs, -inf, inf
        yield "tangents", np.zeros(1) if mesh.tangents is None else mesh.tangents, -1.001, 1.001
        yield "colors", np.zeros(1) if mesh.colors is None else mesh.colors, 0, 1
        yield "triangles", mesh.triangles, 0, len(mesh.positions) - 1
    for instance in scene.instances:
        yield "transform", instance.transform, -inf, inf
        for time in (0.0, 0.3, 1.1):
            mesh = instance.mesh_at(scene.meshes, time)
            yield "transform in motion", instance.transform_at(time), -inf, inf
            yield "positions in motion", mesh.positions, -inf, inf
            yield "normals in motion", mesh.normals, -1.001, 1.001
        if instance.motion is not None:
            yield "motion", instance.motion.transforms, -inf, inf
            yield "times", np.diff(instance.motion.times), 0, inf
    for m in scene.materials:
        yield "albedo", np.array(m.albedo), 0, 1
        yield "specular", np.array(m.specular), 0, 1
        yield "shares", np.array([m.roughness, m.metallic, m.occlusion_strength, m.alpha]), 0, 1
        yield "normal scale, cutoff", np.array([m.normal_scale, m.alpha_cutoff or 0.0]), -inf, inf
        if m.clearcoat is not None:
            yield "clearcoat", np.array([m.clearcoat.strength, m.clearcoat.roughness]), 0, 1
            yield "clearcoat normal scale", np.array([m.clearcoat.normal_scale]), -inf, inf
        if m.sheen is not None:
            yield "sheen", np.array([*m.sheen.color, m.sheen.roughness]), 0, 1
        if m.transmission is not None:
            yield "transmission", np.array([m.transmission.factor, *m.transmission.attenuation_color]), 0, 1
            yield "volume", np.array([m.transmission.ior, m.transmission.thickness]), 0, inf
            assert m.transmission.attenuation_distance > 0  # may be infinite
        yield "emission", np.array(m.emission), 0, inf
        for texture in m.maps.values():
            yield "texture transform", texture.transform, -inf, inf
    for light in scene.lights:
        for field in fields(light):
            low, value = 0.0 if field.name in NON_NEGATIVE else -inf, getattr(light, field.name)
            if isinstance(value, EmissionImage):
                yield "image", value.pixels, 0, inf
            elif value is not None:
                yield field.name, np.asarray(value, np.float64), low, inf
    for path in scene.cameras.values():
        for camera in path.keys:
            yield "camera", np.array([*camera.eye, *camera.target, *camera.up, camera.fov_y_deg]), -inf, inf
