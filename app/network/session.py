"""One onnxruntime call per frame: provider choice, exposure, padding, and a guard at both ends."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from app.errors import DeviceError, ModelError, SettingsError
from app.network.channels import CHANNELS, GLOBALS, PANORAMA, SCREEN
from app.network.contract import ModelContract, TensorSpec, read_contract
from app.network.static_cache import StaticCache, is_cache_tensor

F32 = NDArray[np.float32]

FIREFLY = 32.0  # a texel counts for at most this many times the mean
FLOOR = 1e-20  # smallest divisor; the output is multiplied by the mean itself, so black stays exactly black
_SURFACE = ("solid_angle", "normal.view.xyz", "normal.world.xyz", "depth", "position.view.xyz")
_REMOTE = ("AzureExecutionProvider",)  # sends data to a server: never a choice here


class Network:
    """A loaded, checked and warmed-up network.

    Parameters
    ----------
    path : path
        ``.onnx`` file with a contract.
    size : tuple of int
        Width and height of the screen grid; ``contract.screen_size(output)``.
    provider : str
        ``auto`` (CUDA where it works, else the CPU) or the short name of an execution provider.
    strict : bool
        Refuse to run on another provider than the one asked for.

    Attributes
    ----------
    contract : ModelContract
    provider : str
        Short name of the execution provider that really runs, such as ``cpu``.

    Raises
    ------
    ModelError
        When the file, its contract or the agreement between both is wrong, or the dry run fails.
    SettingsError
        When this onnxruntime has no such provider.
    DeviceError
        When ``strict`` and another provider came up.
    """

    def __init__(self, path: Path | str, size: tuple[int, int], provider: str = "auto", strict: bool = False) -> None:
        self.path = Path(path)
        self.contract = read_contract(path)
        self._session = _open(self.path, provider)
        self.provider = _short(self._session.get_providers()[0])
        if strict and provider not in ("auto", self.provider):
            raise DeviceError(f"the network runs on {self.provider!r}", "--strict-device", f"expected {provider!r}")
        for kind, specs, found in (("input", self.contract.inputs, self._session.get_inputs()),
                                   ("output", self.contract.outputs, self._session.get_outputs())):
            has_cache = self.contract.static_input is not None
            self._check_graph(kind, specs, {t.name: t for t in found if not (has_cache and is_cache_tensor(t.name))})
        try:
            self._cache = StaticCache(self._session, self.contract.static_input)
        except ValueError as error:
            raise ModelError(str(error), self.path, f"expected a graph that caches what depends on {self.contract.static_input!r} "
                             "alone, as its contract says") from None
        self._bounds = {t: _bounds(s) for t, s in self._tensors.items()}
        self.resize(size)

    def resize(self, size: tuple[int, int]) -> None:
        """Allocate for a screen grid of the given width and height, and do one dry run."""
        m = self.contract.multiple_of
        self._size = size[1], size[0]
        self._padded = tuple(-(-n // m) * m for n in self._size)
        self._buffers = {t: np.zeros((1, s.components, *s.extent(self._padded)), np.float32)
                         for t, s in self.contract.inputs.items()}
        self._cache.clear()
        self.run({t: np.zeros((s.components, *s.extent(self._size)), np.float32)
                  for t, s in self.contract.inputs.items()})

    def run(self, tensors: Mapping[str, F32]) -> dict[str, F32]:
        """Infer one frame.

        Parameters
        ----------
        tensors : mapping of str to ndarray, float32
            For each input tensor its ``TensorSpec.shape``, top row first. Left untouched;
            non-finite values become the channel's background or the end of its range.

        Returns
        -------
        dict of str to ndarray, float32, shape (C, h, w)
            By output channel name, finite and inside the channel's range, top row first.

        Raises
        ------
        ModelError
            When onnxruntime fails or a tensor comes back in another shape.
        """
        h, w = self._size
        views = {t: self._buffers[t][0, ..., :h, :w] if s.grid == SCREEN else self._buffers[t][0]
                 for t, s in self.contract.inputs.items()}
        exposure = feed(self.contract, tensors, views)
        for t, spec in self.contract.inputs.items():
            if spec.grid == SCREEN:
                self._buffers[t][..., w:] = self._buffers[t][..., w - 1:w]
                self._buffers[t][..., h:, :] = self._buffers[t][..., h - 1:h, :]
        try:
            given = {t: b.astype(self.contract.dtype, copy=False) for t, b in self._buffers.items()}
            cached = self._cache.feeds(given)
            results = self._session.run([*self.contract.outputs, *self._cache.outputs(cached)], {**given, **cached})
        except Exception as error:  # onnxruntime's own exceptions share no public base class
            raise ModelError(f"the network failed ({_line(error)})", self.path,
                             f"expected it to run on a {w}x{h} grid") from None
        count = len(self.contract.outputs)
        self._cache.update(given, results[count:])
        out: dict[str, F32] = {}
        for (t, spec), result in zip(self.contract.outputs.items(), results[:count], strict=True):
            expected = (1, spec.components, *spec.extent(self._padded))
            if result.shape != expected:
                raise ModelError(f"output {t!r} came back as {list(result.shape)}", self.path,
                                 f"expected {list(expected)}")
            result = _sanitise(result[0, :, :h, :w].astype(np.float32), *self._bounds[t])
            for name, rows in spec.rows():
                if CHANNELS[name].radiance:
                    result[rows] = np.minimum(result[rows] * np.float32(exposure), CHANNELS[name].range[1])
                out[name] = result[rows]
        return out

    @property
    def _tensors(self) -> dict[str, TensorSpec]:
        return {**self.contract.inputs, **self.contract.outputs}

    def _check_graph(self, kind: str, specs: Mapping[str, TensorSpec], found: Mapping[str, ort.NodeArg]) -> None:
        if set(specs) != set(found):
            raise ModelError(f"the contract's {kind}s are {sorted(specs)}", self.path,
                             f"expected the graph's {kind}s {sorted(found)}")
        wanted_type = {"float32": "tensor(float)", "float16": "tensor(float16)"}[self.contract.dtype]
        for t, spec in specs.items():
            shape, wanted = found[t].shape, (1, spec.components, *spec.extent(("h", "w")))
            fits = len(shape) == len(wanted) and all(
                n == m or not (isinstance(n, int) and isinstance(m, int)) for n, m in zip(shape, wanted, strict=True))
            if not fits:
                raise ModelError(f"{kind} {t!r} of the graph has the shape {shape}", self.path,
                                 f"expected {list(wanted)} for {', '.join(spec.channels)}")
            if found[t].type != wanted_type:
                raise ModelError(f"{kind} {t!r} of the graph is a {found[t].type}", self.path,
                                 f"expected {wanted_type}, the contract's dtype")


def feed(contract: ModelContract, tensors: Mapping[str, F32], out: Mapping[str, F32]) -> float:
    """Turn what the renderer packed into what the network is given: finite, in range, sky masked, exposed.

    Parameters
    ----------
    tensors : mapping of str to ndarray, float32
        For each input tensor its ``TensorSpec.shape``; left untouched.
    out : mapping of str to ndarray, float32
        Written, of the same shapes.

    Returns
    -------
    float
        The mean that radiance was divided by and that the output is to be multiplied by; 1 when the contract's
        exposure is ``none``.
    """
    for t, spec in contract.inputs.items():
        _sanitise(tensors[t], *_bounds(spec), out=out[t])
    if contract.exposure == "none":
        return 1.0
    radiance, arriving, whole, texels, surfaces = [], [], 0.0, 0, _surfaces(contract, out)
    for t, spec in contract.inputs.items():
        surface = surfaces.get(spec.grid, np.ones(out[t].shape[1:], bool))
        for name, rows in spec.rows():
            if not CHANNELS[name].radiance:
                continue
            r = out[t][rows]
            radiance.append(r)
            if spec.grid == GLOBALS:  # coefficients, which are light of no place
                continue
            if CHANNELS[name].sky:
                texels += r.size
            else:
                np.multiply(r, surface, out=r)
                texels += int(np.count_nonzero(surface)) * len(r)
            if spec.grid == PANORAMA:
                whole += float(r.sum(dtype=np.float64))
            else:
                arriving.append(r)
    mean = _robust_mean(arriving, whole, texels) if radiance else 1.0
    most = CHANNELS["radiance.rgb"].range[1]
    for r in radiance:
        np.multiply(r, np.float32(1.0 / max(mean, FLOOR)), out=r)
        np.clip(r, -most, most, out=r)
    return mean


def _surfaces(contract: ModelContract, tensors: Mapping[str, F32]) -> dict[str, NDArray[np.bool_]]:
    """By grid, where a surface is seen, as far as some tensor tells."""
    found: dict[str, NDArray[np.bool_]] = {}
    for t, spec in contract.inputs.items():
        rows = dict(spec.rows())
        guide = next((tensors[t][rows[name]] for name in _SURFACE if name in rows), None)
        if guide is not None:
            found.setdefault(spec.grid, (guide != 0).any(axis=0))
    return found


def providers() -> list[str]:
    """Short names of the execution providers of this onnxruntime, best first."""
    return [_short(name) for name in ort.get_available_providers() if name not in _REMOTE]


def check_provider(provider: str) -> None:
    """Refuse what is neither ``auto`` nor a provider of this onnxruntime.

    Raises
    ------
    SettingsError
        With the names to choose from.
    """
    known = ("auto", *providers())
    if provider not in known:
        raise SettingsError(f"unknown provider {provider!r}", "--provider",
                            f"expected one of {', '.join(known)} (what this onnxruntime has)")


def _open(path: Path, provider: str) -> ort.InferenceSession:
    """A session whose threads sleep between frames, or they would slow the passes that follow."""
    check_provider(provider)
    chosen = provider if provider != "auto" else "cuda" if "cuda" in providers() else "cpu"
    wanted = [name for name in ort.get_available_providers() if _short(name) in (chosen, "cpu")]
    options = ort.SessionOptions()
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.intra_op_num_threads = _physical_cores()
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    try:
        # The CPU has nothing to fall back to; onnxruntime would try again, and say so on the terminal.
        return ort.InferenceSession(str(path), options, providers=wanted, enable_fallback=chosen != "cpu")
    except Exception as error:  # onnxruntime's own exceptions share no public base class
        raise ModelError(f"onnxruntime can't load the network ({_line(error)})", path,
                         "expected an ONNX graph that this onnxruntime knows") from None


def _sanitise(values: F32, background: F32, low: F32, high: F32, out: F32 | None = None) -> F32:
    """Clamp to the channels' ranges; NaN becomes the background, infinities the ends of the range."""
    out = np.clip(values, low, high, out=out)
    # Clipping moves infinities and keeps NaN, so what is left to find is NaN.
    bad = np.isnan(out)
    if bad.any():
        np.copyto(out, background, where=bad)
    return out


def _robust_mean(radiance: list[F32], whole: float, count: int) -> float:
    """Mean of values clamped at 32 times their mean, so that one bright texel can't darken the rest; 0 for none.

    Not repeated: where light falls on less than a thirty-second of the texels, that would end at 0. A panorama's light
    counts as a whole, its sum being ``whole``: the one small lit place around the camera is no firefly.
    """
    mean = (sum(float(r.sum()) for r in radiance) + whole) / max(count, 1)
    cap = np.float32(FIREFLY * mean)
    return (sum(float(np.minimum(r, cap).sum()) for r in radiance) + whole) / max(count, 1)


def _bounds(spec: TensorSpec) -> tuple[F32, F32, F32]:
    """Background, smallest and largest value of each tensor channel, broadcastable to the tensor."""
    columns = [[c.background, *c.range] for n in spec.channels for c in [CHANNELS[n]] for _ in range(c.components)]
    shape = (-1, *[1] * len(spec.extent((1, 1))))
    background, low, high = np.array(columns, np.float32).T
    return background.reshape(shape), low.reshape(shape), high.reshape(shape)


def _physical_cores() -> int:
    """Cores this process may use, without hyper-threads; they only fight over the vector units."""
    try:
        folder = Path("/sys/devices/system/cpu")
        return len({(folder / f"cpu{n}/topology/thread_siblings_list").read_text() for n in os.sched_getaffinity(0)})
    except (OSError, AttributeError):
        return os.cpu_count() or 1


def _short(provider: str) -> str:
    return provider.removesuffix("ExecutionProvider").lower()


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
