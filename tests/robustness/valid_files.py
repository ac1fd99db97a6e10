"""One valid file of each kind that uses most features of its reader; the fuzz tests mutate them."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import numpy as np
import onnx

from app.network.contract import KEY
from tests.unit.compressed_files import MESHOPT
from tests.unit.load_helpers import TRIANGLE, Gltf, png

PIXELS = np.random.default_rng(0).integers(0, 255, (8, 8, 4))
PNG = png(PIXELS)
OBJ = """mtllib scene.mtl
o thing
v 0 0 0
v 1 0 0
v 1 1 0 0.5 0.5 0.5
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
g part
usemtl paint
f 1/1/1 2/2/1 3/3/1 4/1/1
usemtl lamp
f -4//1 -3//1 -1//1
l 1 2
"""
MTL = """newmtl paint
Kd 0.5 0.6 0.7
Ks 0.04 0.04 0.04
Ns 30
map_Kd -s 2 2 -o 0.1 0.2 -clamp on paint.png
map_d paint.png
d 0.9
newmtl lamp
Ke 4 3 2
illum 2
"""
PLY = """ply
format ascii 1.0
comment TextureFile paint.png
element vertex 3
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
element face 1
property list uchar int vertex_indices
end_header
0 0 0 255 0 0
1 0 0 0 255 0
0 1 0 0 0 255
3 0 1 2
"""
CAMERA = {"keys": [{"time": 0, "eye": [0, 0, 3], "target": [0, 0, 0]},
                   {"time": 1, "eye": [1, 0, 3], "target": [0, 0, 0], "up": [0, 1, 0]}]}
LENS = {"fx": 500, "fy": 500, "cx": 320, "cy": 240, "width": 640, "height": 480}
SIDECAR = {
    "cameras": {"main": {"eye": [0, 0, 3], "target": [0, 0, 0], "fov_y_deg": 40}, "path": CAMERA,
                "parallel": {"eye": [0, 0, 3], "target": [0, 0, 0], "orthographic_height": 2},
                "lens": {"eye": [0, 0, 3], "target": [0, 0, 0], "intrinsics": LENS}},
    "lightings": {"many": {"emission": 2, "lights": [
        {"type": "point", "position": [0, 0, 2], "intensity": [1, 1, 1], "radius": 0.1},
        {"type": "spot", "position": [0, 1, 2], "target": [0, 0, 0], "intensity": [1, 1, 1], "inner_deg": 10,
         "outer_deg": 20},
        {"type": "directional", "direction": [0, -1, 0], "irradiance": [1, 1, 1], "angular_radius_deg": 0.5},
        {"type": "rectangle", "center": [0, 2, 0], "edge_u": [1, 0, 0], "edge_v": [0, 0, 1], "radiance": [1, 1, 1]}]}},
    "objects": {"part": {"keys": [{"time": 0, "translate": [0, 0, 0], "rotate_deg": [0, 0, 0]},
                                  {"time": 1, "translate": [1, 0, 0], "rotate_deg": [0, 90, 0], "scale": 2}]}},
    "default": {"camera": "main", "lighting": "many"},
}
CATALOGUE = {"cases": {
    "hall": {"scene": "scene.obj", "scene_json": "scene.json", "lighting": "many", "model": "gather", "size": [32, 24],
             "shots": [{"camera": "path", "frames": 2}, {"camera": "main"}], "kept": [1, 3], "taa": True},
    "plain": {"scene": "scene.obj"}}}


def gltf() -> Gltf:
    """All maps and layers of materials, two uv sets, mask, emission, variants, sparse and normalised accessors,
    instancing, a mirrored node, cameras and lights; a skin, a morph target, and an animation of nodes and weights.
    """
    file = Gltf()
    transform = {"offset": [0.1, 0.2], "rotation": 1, "scale": [2, 2]}
    color = {"index": file.texture(PIXELS), "extensions": {"KHR_texture_transform": transform}}
    other = {"index": color["index"], "texCoord": 1}
    mirrored = {"index": file.texture(PIXELS, wrapS=33648, wrapT=33648, magFilter=9728)}
    file.material(name="m", pbrMetallicRoughness={"baseColorTexture": color, "baseColorFactor": [1, 1, 1, 0.8],
                                                  "metallicFactor": 0.2, "roughnessFactor": 0.3,
                                                  "metallicRoughnessTexture": other},
                  alphaMode="MASK", alphaCutoff=0.4, emissiveFactor=[1, 0.5, 0], emissiveTexture=mirrored,
                  normalTexture={**other, "scale": 0.5}, occlusionTexture={**other, "strength": 0.5},
                  extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 3}, **_layers(color, other)})
    file.material(extensions={"KHR_materials_pbrSpecularGlossiness": {
        "diffuseTexture": color, "glossinessFactor": 0.5, "specularGlossinessTexture": color}})
    file.material(pbrMetallicRoughness={"baseColorTexture": color}, extensions={"KHR_materials_unlit": {}})
    file.primitive["material"] = 0
    file.primitive["extensions"] = {"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [0]},
                                                                            {"material": 2, "variants": [1]}]}}
    file.primitive["attributes"] |= {
        "NORMAL": file.array(TRIANGLE), "TEXCOORD_0": file.array(TRIANGLE[:, :2]),
        "TEXCOORD_1": file.array(TRIANGLE[:, 1:]),
        "COLOR_0": file.array(np.full((3, 4), 200, np.uint8), normalized=True)}
    file.primitive["indices"] = file.array(np.array([0, 1, 2], np.uint16))
    file.json["accessors"][0]["sparse"] = {
        "count": 1, "indices": {"bufferView": file.view(b"\x00\x00"), "componentType": 5123},
        "values": {"bufferView": file.view(struct.pack("<fff", 0, 0, 1))}}
    instances = {"TRANSLATION": file.array(TRIANGLE), "ROTATION": file.array(np.eye(4, dtype=np.float32)[:3])}
    file.json["nodes"] = [
        {"mesh": 0, "name": "thing", "children": [1, 2], "rotation": [0, 0, 0, 1], "scale": [1, -1, 1]},
        {"mesh": 0, "camera": 0, "translation": [0, 0, 2], "extensions": {
            "KHR_lights_punctual": {"light": 0}, "EXT_mesh_gpu_instancing": {"attributes": instances}}},
        {"matrix": np.eye(4).ravel().tolist(), "camera": 1, "extensions": {"KHR_lights_punctual": {"light": 1}}},
        {"mesh": 1, "skin": 0, "weights": [0.3]}, {"children": [5], "translation": [0, 0, -1]}, {"scale": [1, 2, 1]}]
    file.json["scenes"][0]["nodes"] = [0, 3, 4]
    _add_motion(file)
    file.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}},
                            {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1}}]
    file.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "dull"}, {"name": "unlit"}]},
                               "KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 1, 1], "intensity": 5, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}},
        {"type": "directional", "intensity": 2}]}}
    return file


def _layers(color: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    return {
        "KHR_materials_ior": {"ior": 1.4},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 0.9, 0.8],
                                   "specularTexture": color, "specularColorTexture": color},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.3, "clearcoatTexture": other,
                                    "clearcoatRoughnessTexture": color, "clearcoatNormalTexture": other},
        "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.2, 0.3], "sheenRoughnessFactor": 0.5,
                                "sheenColorTexture": color, "sheenRoughnessTexture": color},
        "KHR_materials_transmission": {"transmissionFactor": 0.5, "transmissionTexture": color},
        "KHR_materials_volume": {"thicknessFactor": 0.1, "thicknessTexture": color, "attenuationDistance": 2,
                                 "attenuationColor": [1, 0.5, 0.5]}}


def _add_motion(file: Gltf) -> None:
    """Mesh 1 with a morph target, skin 0 of joints 4 and 5, and an animation of their nodes and weights."""
    joints = np.tile(np.array([0, 1, 0, 0], np.uint8), (3, 1))
    file.json["meshes"].append({"primitives": [{
        "attributes": {"POSITION": file.array(TRIANGLE), "NORMAL": file.array(TRIANGLE), "JOINTS_0": file.array(joints),
                       "WEIGHTS_0": file.array(np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]], np.float32))},
        "targets": [{"POSITION": file.array(TRIANGLE), "NORMAL": file.array(TRIANGLE)}]}]})
    binds = np.tile(np.eye(4, dtype=np.float32).ravel(), (2, 1))
    file.json["skins"] = [{"joints": [4, 5], "inverseBindMatrices": file.array(binds, type="MAT4")}]
    times = file.array(np.array([0, 0.5, 1], np.float32))
    outputs = {"rotation": np.eye(4)[[3, 2, 1]], "translation": np.eye(3)[[0] * 9], "weights": np.array([0, 1, 0])}
    targets = {"rotation": 5, "translation": 4, "weights": 3}
    file.json["animations"] = [{
        "name": "wave",
        "samplers": [{"input": times, "output": file.array(values.astype(np.float32)),
                      "interpolation": "CUBICSPLINE" if len(values) == 9 else "LINEAR"} for values in outputs.values()],
        "channels": [{"sampler": number, "target": {"node": targets[path], "path": path}}
                     for number, path in enumerate(outputs)]}]


def binary_gltf(file: Gltf) -> tuple[dict[str, Any], bytes]:
    """The JSON of the file with one binary buffer instead of data URIs, and that buffer."""
    document, binary = json.loads(json.dumps(file.json)), b""
    starts = []
    for buffer in document["buffers"]:
        starts.append(len(binary))
        if "uri" in buffer:
            data = base64.b64decode(buffer["uri"].split(",")[1])
            binary += data + bytes(-len(data) % 4)
    for view in document["bufferViews"]:
        for part in (view, view.get("extensions", {}).get(MESHOPT)):
            if part is not None:
                part.update(buffer=0, byteOffset=starts[part["buffer"]])
    document["buffers"] = [{"byteLength": len(binary)}]
    return document, binary


def glb(document: Any, binary: bytes) -> bytes:
    """A GLB file with these two chunks."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def embed_contract(network: bytes, contract: bytes) -> bytes:
    """An ONNX file with any bytes as its contract."""
    model = onnx.ModelProto.FromString(network)
    onnx.helper.set_model_props(model, {KEY: contract.decode("utf-8", "replace")})
    return model.SerializeToString()
