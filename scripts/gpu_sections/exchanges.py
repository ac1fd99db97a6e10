"""Ways of the tensors between OpenGL and onnxruntime: the light that they give, and the time of frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import closing
from itertools import product

import numpy as np

from app.arrays import F32
from app.exchange.copy import CopyExchange
from app.exchange.mapped import MappedExchange
from app.exchange.selection import OpenExchange, open_exchange
from app.gl.context import Device
from app.load import embedded_scene, orbit
from app.network.contract_json import read_contract
from app.network.cuda_runtime import READ_ONLY, find_cuda
from app.network.providers import AUTO, CPU
from app.network.selection import DEFAULT_MODEL, SURFEL_MODEL, find_models
from app.paths import nets_dir
from app.renderer import Renderer
from app.settings import Settings
from gpu_sections.common import REPEATS, WARM_UP, Json, Options, format_size, max_error, measure_ms, skipped

EXCHANGES: Mapping[str, OpenExchange] = {"copy": CopyExchange, "mapped": MappedExchange, "chosen": open_exchange}


def exchanges(options: Options) -> Json:
    """Frames of the embedded scene by each exchange, and by the one that is chosen here."""
    rows: Json = {}
    for model, size in product((SURFEL_MODEL, DEFAULT_MODEL), options.sizes):
        light: dict[str, F32] = {}
        for label, exchange in EXCHANGES.items():
            row, light[label] = _measure(model, size, exchange, options)
            rows[f"{model} {format_size(size)} {label}"] = {
                **row, "max_difference": max_error(light[label], light["copy"])}
    return {**rows, "map and unmap": _measure_mapping(options)}


def _measure(model: str, size: tuple[int, int], exchange: OpenExchange, options: Options) -> tuple[Json, F32]:
    scene = embedded_scene()
    cameras = iter(orbit(scene, scene.cameras[scene.default_camera].at(0.0), 2 * (WARM_UP + REPEATS)))
    provider = CPU if exchange is MappedExchange else AUTO
    with Renderer(scene, Settings(size, provider=provider), find_models(model), exchange) as renderer:
        times = measure_ms(lambda: renderer.advance(next(cameras)), options)
        return {"device": renderer.device, "frame_ms": times}, renderer.resource("indirect_now").astype(np.float32)


def _measure_mapping(options: Options) -> Json:
    """What CUDA takes to map GL buffers for ember's inputs, after a pass has written one, and to let go."""
    contract = read_contract(nets_dir() / f"{SURFEL_MODEL}.onnx")
    with closing(Device()) as device, device.ctx:
        cuda = find_cuda()
        if cuda is None or not cuda.shares_device():
            return skipped("CUDA does not share OpenGL's device")
        shapes = contract.padded_shapes(contract.inputs, contract.screen_size(options.sizes[0]))
        buffers = [device.ctx.buffer(reserve=4 * math.prod(shape)) for shape in shapes.values()]
        resources = [cuda.register(buffer.glo, READ_ONLY) for buffer in buffers]

        def map_once() -> None:
            buffers[0].clear()
            with cuda.mapped(resources):
                pass

        def map_and_wait() -> None:
            map_once()
            cuda.synchronize()

        row = {"issued": measure_ms(map_once, options, 100), "finished": measure_ms(map_and_wait, options, 100)}
        cuda.synchronize()
        for resource in resources:
            cuda.unregister(resource)
        return row
