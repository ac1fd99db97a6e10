"""One valid file of each kind that uses most features of its reader; the fuzz tests mutate them."""

from __future__ import annotations

import base64
import json
import struct
from typing import Any

import numpy as np
import onnx

from app.network.contract import KEY
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
SIDECAR = {
    "cameras": {"main": {"eye": [0, 0, 3], "target": [0, 0, 0], "fov_y_deg": 40}, "path": CAMERA},
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
    """Texture, mask, emission, sparse and normalised accessors, instancing, a mirrored node, camera and lights."""
    file = Gltf()
    transform = {"offset": [0.1, 0.2], "rotation": 1, "scale": [2, 2]}
    color = {"index": file.texture(PIXELS), "extensions": {"KHR_texture_transform": transform}}
    file.material(name="m", pbrMetallicRoughness={"baseColorTexture": color, "baseColorFactor": [1, 1, 1, 0.8],
                                                  "metallicFactor": 0.2, "roughnessFactor": 0.3},
                  alphaMode="MASK", alphaCutoff=0.4, emissiveFactor=[1, 0.5, 0],
                  extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 3}})
    file.primitive["attributes"] |= {
        "NORMAL": file.array(TRIANGLE), "TEXCOORD_0": file.array(TRIANGLE[:, :2]),
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
        {"matrix": np.eye(4).ravel().tolist(), "extensions": {"KHR_lights_punctual": {"light": 1}}}]
    file.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    file.json["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "spot", "color": [1, 1, 1], "intensity": 5, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.3}},
        {"type": "directional", "intensity": 2}]}}
    return file


def binary_gltf() -> tuple[dict[str, Any], bytes]:
    """The JSON of the same file with one binary buffer instead of data URIs, and that buffer."""
    document, binary = json.loads(json.dumps(gltf().json)), b""
    for view, buffer in zip(document["bufferViews"], document["buffers"], strict=True):
        data = base64.b64decode(buffer["uri"].split(",")[1])
        view.update(buffer=0, byteOffset=len(binary), byteLength=len(data))
        binary += data + bytes(-len(data) % 4)
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
