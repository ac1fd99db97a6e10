"""The frame graph: passes declare what they read and write; ``compile_graph`` culls, orders and checks.

It needs no GL. The graph is walked back from the requested outputs, so a pass whose results nothing needs is never
compiled, allocated or run.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from app.errors import GraphError

PREVIOUS = "@prev"


@dataclass(frozen=True)
class Tex:
    """A 2-D texture that a pass writes.

    Attributes
    ----------
    dtype : str
        ``f1`` (8-bit normalised), ``f2`` (half) or ``f4`` (float).
    components : int
        1, 2 or 4.
    scale : float
        Size relative to that at which frames are drawn, rounded up; ignored when ``size`` is given.
    size : tuple of int or None
        Fixed width and height in texels.
    """

    dtype: str
    components: int
    scale: float = 1.0
    size: tuple[int, int] | None = None

    def resolve(self, frame: tuple[int, int]) -> tuple[int, int]:
        """Width and height in texels in a ``frame`` of the given width and height."""
        if self.size is not None:
            return self.size
        return tuple(max(1, math.ceil(n * self.scale)) for n in frame)  # type: ignore[return-value]


@dataclass(frozen=True)
class Buf:
    """A tensor of float32 that a pass writes, shaped (C, h, w).

    Attributes
    ----------
    on_host : bool
        Whether it is made and read on the CPU, and has no buffer on the GPU.
    """

    shape: tuple[int, ...]
    on_host: bool = False


Resource = Tex | Buf


@dataclass(frozen=True)
class Pass:
    """One stage, as data.

    Attributes
    ----------
    reads : tuple of str
        Needed resources; ``name@prev`` is last frame's copy.
    optional : tuple of str
        Resources that are used where another pass writes them; ``HAS_X`` defines tell the shaders.
    writes : mapping of str to Tex or Buf
        What the pass can write. Only what a later pass reads is allocated.
    make : callable or None
        ``make(device, bound)`` builds the GL objects and returns ``execute(frame, resources)``.
    """

    name: str
    reads: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    writes: Mapping[str, Resource] = field(default_factory=dict)
    make: Callable[..., Any] | None = None


@dataclass(frozen=True)
class Absent:
    """A pass that scene and settings leave out, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class BoundPass:
    """A pass as the plan runs it: which optional reads exist and which writes are wanted."""

    spec: Pass
    reads: tuple[str, ...]
    writes: tuple[str, ...]

    @property
    def name(self) -> str:
        return self.spec.name


@dataclass(frozen=True)
class Plan:
    """The order in which passes run, what was culled and why, and which resources keep a history."""

    passes: tuple[BoundPass, ...]
    culled: Mapping[str, str]
    history: frozenset[str]
    resources: Mapping[str, Resource]


def compile_graph(steps: Iterable[Pass | Absent], outputs: Iterable[str]) -> Plan:
    """Cull, order and check a frame.

    Parameters
    ----------
    steps : iterable of Pass or Absent
        All passes in the order of the frame.
    outputs : iterable of str
        Resources that must exist at the end.

    Raises
    ------
    GraphError
        Unmet reads, double writers and cycles, all at once.
    """
    steps = list(steps)
    passes = [p for p in steps if isinstance(p, Pass)]
    writer: dict[str, Pass] = {}
    problems: list[str] = []
    for p in passes:
        for name in p.writes:
            if name in writer:
                problems.append(f"{name!r} is written by both {writer[name].name!r} and {p.name!r}")
            writer[name] = p

    wanted: dict[str, set[str]] = {}
    history: set[str] = set()
    active: dict[str, Pass] = {}
    todo = [(name, "the outputs") for name in outputs]
    while todo:
        name, reader = todo.pop()
        resource = name.removesuffix(PREVIOUS)
        if name != resource:
            history.add(resource)
        if resource not in writer:
            problems.append(f"{resource!r}, read by {reader}, has no writer")
            continue
        p = writer[resource]
        wanted.setdefault(p.name, set()).add(resource)
        if p.name not in active:
            active[p.name] = p
            todo += [(r, repr(p.name)) for r in _present(p, writer)]

    order = _sort([p for p in passes if p.name in active], writer, problems)
    if problems:
        raise GraphError("passes do not fit together: " + "; ".join(sorted(set(problems))), "frame graph",
                         "expected every read to have exactly one writer, without cycles")
    culled = {p.name: p.reason if isinstance(p, Absent) else "nothing reads " + ", ".join(p.writes)
              for p in steps if p.name not in active}
    bound = tuple(BoundPass(p, tuple(_present(p, writer)), tuple(w for w in p.writes if w in wanted[p.name]))
                  for p in order)
    resources = {w: b.spec.writes[w] for b in bound for w in b.writes}
    return Plan(bound, culled, frozenset(history), resources)


def _present(p: Pass, writer: Mapping[str, Pass]) -> list[str]:
    return list(p.reads) + [r for r in p.optional if r.removesuffix(PREVIOUS) in writer]


def _sort(passes: list[Pass], writer: Mapping[str, Pass], problems: list[str]) -> list[Pass]:
    """Sort topologically, keeping the given order where it is free; reads of ``@prev`` are no edges."""
    done: set[str] = set()
    order: list[Pass] = []
    waiting = list(passes)
    while waiting:
        ready = next((p for p in waiting if all(
            r.endswith(PREVIOUS) or r not in writer or writer[r].name in done for r in _present(p, writer))), None)
        if ready is None:
            problems.append("a cycle runs through " + ", ".join(repr(p.name) for p in waiting))
            return order
        waiting.remove(ready)
        done.add(ready.name)
        order.append(ready)
    return order
