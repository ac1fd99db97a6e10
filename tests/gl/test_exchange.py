"""Ways of a network's tensors: all give the same light, and CUDA's is used by its rules."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import helper

from app.errors import ModelError
from app.exchange import exposure
from app.exchange.copy import CopyExchange
from app.exchange.cuda import CudaExchange
from app.exchange.mapped import MappedExchange
from app.exchange.selection import OpenExchange, open_exchange
from app.gl.context import Device
from app.golden.catalogue import PROBE, PROBE_ENVIRONMENT
from app.golden.scenes import noon, room
from app.network.bounces import RepeatedNetwork
from app.network.contract import KEY, ModelContract
from app.network.contract_json import contract_to_json, read_contract
from app.network.cuda_runtime import READ_ONLY, CudaRuntime
from app.network.selection import find_model
from app.network.session import Network
from app.renderer import Renderer
from app.settings import Settings
from tests.fake_cuda import FakeCudart
from tests.override import override
from tests.robustness.networks import write_network
from tests.tiny_network import write_tiny_network

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (61, 47)
POISONS = (np.nan, np.inf, -np.inf, -100.0)
EPSILON = 4e-6  # relative: sums of radiance in another order
Image = NDArray[np.float32]


class StagedExchange(MappedExchange):
    """The buffers of ``MappedExchange``, read back for an ordinary run of the session, whose results are uploaded."""

    def __init__(self, device: Device, network: Network, size: tuple[int, int]) -> None:
        super().__init__(device, network, size)
        self.session = network._session

    def _infer(self) -> None:
        self._device.ctx.finish()
        inputs = {t: self._values(t).copy() for t in self._contract.inputs}
        for tensor, values in zip(self._contract.outputs, self.session.run([*self._contract.outputs], inputs),
                                  strict=True):
            self._values(tensor)[...] = values


@pytest.fixture
def cudart() -> Iterator[FakeCudart]:
    library = FakeCudart()
    yield library
    library.close()


def on_cuda(library: FakeCudart) -> OpenExchange:
    runtime = library.runtime()
    return lambda device, network, size: CudaExchange(device, network, size, runtime)


def draw_sequence(models: list[Path], exchange: OpenExchange) -> list[Image]:
    """Low-resolution light, and the final image, of frames in which everything happens that may disturb an exchange."""
    scene = room()
    path = scene.cameras["path"]
    images = []
    for model in models:  # the second one is swapped in
        with Renderer(scene, Settings(SIZE, provider="cpu", reflections=False), model, exchange) as renderer:
            def frames(numbers: range, renderer: Renderer = renderer) -> None:
                for number in numbers:
                    final = renderer.render(path.at(number / 30), number / 30)["final"]
                    images.extend((renderer.resource("indirect_now"), final))

            frames(range(3))
            renderer.cut()
            frames(range(40, 42))
            renderer.set_render_scale(0.5)
            frames(range(42, 44))
            renderer.set_render_scale(1.0)
            frames(range(44, 45))
            for poison in POISONS:
                override(renderer, "direct", lambda image, value=poison: with_texel(image, value))
                frames(range(45, 46))
            override(renderer, "direct", 0.25)
            frames(range(46, 47))
            override(renderer, "direct", None)
            frames(range(47, 48))
    return images


def with_texel(image: Image, value: float) -> Image:
    image = image.astype(np.float32)
    image[24, 30] = value
    return image


@pytest.fixture(scope="module")
def models(small_ember: Path) -> list[Path]:
    """One that reads surfels on the CPU and one that reads what is drawn, padded."""
    return [small_ember, Path(find_model("bcnn-8"))]


@pytest.fixture(scope="module")
def mapped_images(models: list[Path]) -> list[Image]:
    return draw_sequence(models, MappedExchange)


def test_mapped_memory_gives_the_bits_of_copies(models: list[Path], mapped_images: list[Image]) -> None:
    for mapped, staged in zip(mapped_images, draw_sequence(models, StagedExchange), strict=True):
        np.testing.assert_array_equal(mapped, staged)
    assert all(np.isfinite(image).all() and image[..., :3].mean() > 0.01 for image in mapped_images)


def test_cuda_gives_the_bits_of_mapped_memory(models: list[Path], mapped_images: list[Image],
                                              cudart: FakeCudart) -> None:
    for mapped, registered in zip(mapped_images, draw_sequence(models, on_cuda(cudart)), strict=True):
        np.testing.assert_array_equal(registered, mapped)
    assert cudart.mappings == len(mapped_images) // 2


def test_without_exposure_the_gpu_prepares_the_bits_of_the_cpu(tmp_path: Path) -> None:
    """Padded, with a network that squares what it gets."""
    path = write_network(tmp_path / "square.onnx", ("Mul", ["light", "light"], "y"), exposure="none")
    copies, mapped = (draw_sequence([path], exchange) for exchange in (CopyExchange, MappedExchange))
    for one, other in zip(copies, mapped, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_grid_may_have_more_texels_than_all_workgroups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exposure, "MAX_EXPOSE_GROUPS", 3)
    path = write_network(tmp_path / "square.onnx", ("Mul", ["light", "light"], "y"), exposure="none")
    scene, images = room(), []
    for exchange in (CopyExchange, MappedExchange):
        with Renderer(scene, Settings(SIZE, taa=False, provider="cpu", scale=1.0), path, exchange) as renderer:
            images.append(renderer.render(scene.cameras["path"].at(0.0))["final"])
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize("name", ["indirect light", "environment", "padded"])
@pytest.mark.parametrize("poison", [None, *POISONS])
def test_the_gpu_prepares_what_the_cpu_prepares(name: str, poison: float | None, tmp_path: Path) -> None:
    """The light of networks that read every channel on every grid, exposed, and of one that sees its padding.

    Tensors may hold what is no number.
    """
    file = {"indirect light": PROBE, "environment": PROBE_ENVIRONMENT}.get(name) or write_tiny_network(
        tmp_path / "tiny.onnx")
    contract = replace(read_contract(file), exposure="mean-radiance")
    file = with_contract(file, contract, tmp_path / file.name)
    scene, targets, prefix = ((noon(), ("environment_diffuse_low", "environment_specular_low"), "environment_")
                              if contract.shades_environment else (room(), ("indirect_low",), ""))
    camera = scene.cameras[scene.default_camera].at(0.0)
    found = []
    for exchange in (CopyExchange, MappedExchange):
        with Renderer(scene, Settings(SIZE, taa=False, provider="cpu"), [file], exchange) as renderer:
            if poison is not None:
                for tensor in contract.inputs:
                    override(renderer, f"{prefix}tensor_{tensor}", lambda values: spoilt(values, poison))
            renderer.advance(camera)
            found.append([renderer.resource(target) for target in targets if target in renderer.plan.resources])
    assert found[0]
    for copy, mapped in zip(*found, strict=True):
        assert np.isfinite(mapped).all()
        np.testing.assert_allclose(mapped, copy, rtol=1e-4, atol=EPSILON * float(np.abs(copy).max()))


def with_contract(file: Path, contract: ModelContract, path: Path) -> Path:
    """A copy of a network with another contract."""
    model = onnx.load(file)
    helper.set_model_props(model, {KEY: contract_to_json(contract)})
    onnx.save(model, path)
    return path


def spoilt(values: NDArray[Any], value: float) -> NDArray[Any]:
    """Every 53rd number of a tensor replaced."""
    values = values.copy()
    values.reshape(-1)[::53] = value
    return values


def test_a_shape_that_goes_wrong_later_is_refused(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "late.onnx", output_width="first")
    scene = room()
    with (Renderer(scene, Settings(SIZE, provider="cpu"), path, MappedExchange) as renderer,
          pytest.raises(ModelError, match=r"late\.onnx: the network failed \(")):
        renderer.render(scene.cameras["path"].at(0.0))


def test_each_network_gets_the_exchange_that_it_and_the_machine_allow(tmp_path: Path,
                                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    device = Device()
    plain, half, cached = (Network(find_model(name), (8, 8), "cpu") for name in ("bcnn-8", "bcnn-8-half", "gfa-8"))
    repeated = RepeatedNetwork(Network(write_tiny_network(tmp_path / "tiny.onnx"), (8, 8), "cpu"), 3)

    def chosen(network: Any) -> str:
        exchange = open_exchange(device, network, (8, 8))
        exchange.release()
        return exchange.name

    with device.ctx:
        monkeypatch.setattr(device, "software", True)
        assert chosen(plain) == "copy"
        monkeypatch.setattr(device, "software", False)
        assert [chosen(network) for network in (plain, half, cached, repeated)] == ["mapped", "copy", "copy", "copy"]
        plain.provider = "cuda"
        for devices, expected in (((0,), "cuda"), ((1,), "copy"), ((), "copy")):
            library = FakeCudart(devices)
            plain.cuda = library.runtime()
            assert chosen(plain) == expected
            library.close()
    device.close()


class Books:
    """A runtime on the fake library, with two registered buffers of GL."""

    def __init__(self) -> None:
        self.device = Device()
        self.buffers = [self.device.ctx.buffer(bytes(64)) for _ in range(2)]
        self.library = FakeCudart()
        self.runtime = self.library.runtime()
        self.resources = [self.runtime.register(buffer.glo, READ_ONLY) for buffer in self.buffers]


@pytest.fixture
def books() -> Iterator[Books]:
    books = Books()
    with books.device.ctx:
        yield books
    books.device.close()


def test_the_fake_accepts_what_is_right(books: Books) -> None:
    for _ in range(2):
        with books.runtime.mapped(books.resources) as addresses:
            assert len(set(addresses)) == 2
    books.runtime.synchronize()
    for resource in books.resources:
        books.runtime.unregister(resource)
    books.library.close()


def test_the_fake_finds_what_is_wrong(books: Books) -> None:
    runtime, resources = books.runtime, books.resources
    with pytest.raises(AssertionError, match="leak: 2 buffers"):
        books.library.close()
    with pytest.raises(AssertionError, match="used while it is not mapped"):
        runtime._address(resources[0])
    with runtime.mapped(resources), pytest.raises(AssertionError, match="mapped twice"):
        runtime.mapped(resources).__enter__()
    with runtime.mapped(resources), pytest.raises(AssertionError, match="unregistered while mapped"):
        runtime.unregister(resources[0])
    with pytest.raises(AssertionError, match="two different streams"):
        CudaRuntime(books.library).mapped(resources).__enter__()
    with pytest.raises(AssertionError, match="registered twice"):
        runtime.register(books.buffers[0].glo, READ_ONLY)
    with pytest.raises(AssertionError, match="GL has no buffer"):
        runtime.register(4711, READ_ONLY)
    runtime.unregister(resources[1])
    with pytest.raises(AssertionError, match="not registered"):
        runtime.unregister(resources[1])


def test_the_fake_finds_buffers_that_two_use_at_once(books: Books) -> None:
    mapped, _ = books.device.map_buffer(64)
    resource = books.runtime.register(mapped.glo, READ_ONLY)
    with pytest.raises(AssertionError, match="mapped by GL"):
        books.runtime.mapped([resource]).__enter__()
    with pytest.raises(AssertionError, match="GL wrote"), books.runtime.mapped(books.resources):
        books.buffers[0].write(np.ones(16, np.float32))


def test_the_fake_finds_writes_after_unmapping(books: Books) -> None:
    with books.runtime.mapped(books.resources) as (address, _):
        pass
    (ctypes.c_float * 16).from_address(address)[3] = 1.0
    with pytest.raises(AssertionError, match="after it was unmapped"):
        books.runtime.mapped(books.resources).__enter__()


def test_the_fake_finds_work_that_nobody_has_waited_for(books: Books) -> None:
    with books.runtime.mapped(books.resources):
        pass
    for resource in books.resources:
        books.runtime.unregister(resource)
    with pytest.raises(AssertionError, match="nobody has waited"):
        books.library.close()
