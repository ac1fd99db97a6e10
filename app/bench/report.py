"""The HTML report: one file that needs no other."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.bench.headlines import networks
from app.bench.plots import growth, scatter, stages
from app.bench.rows import number
from app.evaluation.embedded_images import shown
from app.evaluation.picture_errors import AMBIENT
from app.evaluation.timing import FRAME

Json = dict[str, Any]
F32 = NDArray[np.float32]

LAYERS = ("final", "indirect", "direct")
COLUMNS = {"flip": "FLIP", "psnr": "PSNR", "ssim": "SSIM", "rel_mse": "relMSE"}


def html_report(results: Json, pictures: dict[str, dict[str, F32]]) -> str:
    """The page as text.

    Parameters
    ----------
    results : dict
        As in the JSON file.
    pictures : dict
        Linear pictures by scene and label, among them each scene's ``reference``.
    """
    width, height = results["scenes"][0]["reference"]["size"]
    # "</" would end the script.
    data = json.dumps({scene: shown(images) for scene, images in pictures.items()}).replace("</", "<\\/")
    return fill_page(
        "page.html", pictures=data,
        machine=_machine(results), headlines=_headlines(results["headlines"]), judged=f"{width}×{height}",
        scatter=scatter(results), stages=stages(results), scenes="\n".join(map(_scene, results["scenes"])),
        growth=_growth(results["growth"]) if "growth" in results else "")


def fill_page(name: str, **parts: str) -> str:
    """A page of this package with its ``parts``, and what sliders between two pictures need."""
    folder = resources.files("app.bench")
    style, script = ((folder / f"slider.{kind}").read_text("utf-8").rstrip("\n") for kind in ("css", "js"))
    return Template((folder / name).read_text("utf-8")).substitute(slider_style=style, slider=script, **parts)


def _machine(results: Json) -> str:
    m, devices = results["machine"], [c["device"] for s in results["scenes"] for c in s["configurations"]]
    renderers = sorted({f"{d['gl_renderer']}, OpenGL {d['gl_version']}" for d in devices})
    providers = sorted({d["provider"] for d in devices} - {"none"}) or ["none"]
    lines = [
        f"{m['processor']}, {m['cores']} logical and {m['physical_cores']} physical cores, {m['memory_gb']} GB",
        f"{m['system']}, Python {m['python']}, load {m['load_average']:.1f} at the start",
        f"GL renderer {', '.join(renderers)}; execution provider {', '.join(providers)}",
        ", ".join(f"{name} {version}" for name, version in m["versions"].items()),
        f"{results['command']} ({results['seconds']:.0f} s)", *results["absent"],
    ]
    return "<br>".join(map(escape, lines))


def _headlines(found: Sequence[Json]) -> str:
    scenes = list(dict.fromkeys(name for row in found for name in row["scenes"]))
    body = []
    for row in found:
        for key, what in (("speed_up", "speed-up at equal error"), ("error_ratio", "error ratio at equal time")):
            own = [_ratio(row["scenes"][s][key]) if s in row["scenes"] else "–" for s in scenes]
            body.append([f"{row['model']} against {row['against']}: {what}", _ratio(row[key]), *own])
    return html_table(["", "mean", *scenes], body) if found else "<p>No network was measured beside a baseline.</p>"


def _scene(scene: Json) -> str:
    reference, name = scene["reference"], escape(scene["name"])
    first = escape(next(iter(networks(scene)), AMBIENT))
    noise = ", ".join(f"{layer} {value:.2%}" for layer, value in reference["noise"].items() if value is not None)
    about = (f"{scene['triangles']} triangles, {scene['lights']} light{'s' * (scene['lights'] != 1)}"
             + (f" (lighting {scene['lighting']})" if scene["lighting"] else "")
             + (f"; reference of {reference['spp']} samples per pixel" if "spp" in reference else "")
             + (f", noise {noise}" if noise else "") + "".join(f"; {notice}" for notice in reference["notices"]))
    return (f'<h2>{name}</h2><p class=note>{escape(about)}</p><div data-scene="{name}" data-first="{first}">'
            '<div class=pair><img alt=right><img class=over alt=left></div><div class=controls><select></select>'
            '<input type=range value=50><select></select></div></div>' + _errors(scene) + _times(scene))


def _errors(scene: Json) -> str:
    entries = [(c["label"], c["stages"][FRAME]["median"], c["errors"]) for c in scene["configurations"] if c["errors"]]
    entries.append((AMBIENT, None, scene["ambient"]["errors"]))
    entries += [(f"{r['name']}, {r['spp']} spp", r["ms"], r["errors"]) for r in scene["baselines"]]
    head = ["", "ms", *(text for _ in LAYERS for text in COLUMNS.values())]
    above = "<tr><td colspan=2>" + "".join(f"<th colspan={len(COLUMNS)}>{layer}" for layer in LAYERS)
    body = [[label, "–" if ms is None else number(ms),
             *(number(errors[layer][m]) if layer in errors else "–" for layer in LAYERS for m in COLUMNS)]
            for label, ms, errors in entries]
    return "<h3>Errors</h3>" + html_table(head, body, above)


def _times(scene: Json) -> str:
    parts = ["<h3>Times</h3>"]
    for size in dict.fromkeys(tuple(c["size"]) for c in scene["configurations"]):
        entries = [c for c in scene["configurations"] if tuple(c["size"]) == size]
        names = list(dict.fromkeys(n for c in entries for n in c["stages"] if n != FRAME))
        body = [[n, *(_spread(c["stages"].get(n)) for c in entries)] for n in [*names, FRAME]]
        if any(c["fresh"] for c in entries):
            body += [["start-up s", *(number(c["fresh"]["startup_s"]) if c["fresh"] else "–" for c in entries)],
                     ["peak memory MB", *(number(c["fresh"]["peak_mb"]) if c["fresh"] else "–" for c in entries)]]
        heads = [c["label"] + (f" ({c['grid'][0]}×{c['grid'][1]})" if c["grid"] else "") for c in entries]
        parts.append(html_table([f"{size[0]}×{size[1]}", *heads], body))
    return "".join(parts)


def _growth(found: Json) -> str:
    note = (f"In a generated hall whose block moves, with {found['model']}. Each stage's median time is fitted with a "
            "power of the quantity; the exponent's standard error follows it. Surfels and width are those of networks "
            "of their own, radiosity and BCNN.")
    parts = ["<h2>How cost grows</h2>", f"<p class=note>{escape(note)}</p>", growth(found["sweeps"])]
    for quantity, data in found["sweeps"].items():
        body = [[name, *map(number, s["ms"]),
                 "–" if s["exponent"] is None else f"{s['exponent']:.2f} ± {s['error']:.2f}"]
                for name, s in data["stages"].items()]
        parts.append(html_table([quantity, *map(str, data["counts"]), "exponent"], body))
    return "".join(parts)


def html_table(head: Sequence[str], body: Iterable[Sequence[str]], above: str = "") -> str:
    """A table of texts, which scrolls where it is too wide; ``above`` are rows before its head."""
    lines = [above, "<tr>" + "".join(f"<th>{escape(cell)}" for cell in head)]
    lines += ["<tr>" + "".join(f"<td>{escape(cell)}" for cell in row) for row in body]
    return "<div class=scroll><table>" + "".join(lines) + "</table></div>"


def _ratio(ratio: Json) -> str:
    return f"{ratio['bound']}{number(ratio['value'])}×"


def _spread(spread: Json | None) -> str:
    return "–" if spread is None else f"{number(spread['median'])} ({number(spread['p95'])})"
