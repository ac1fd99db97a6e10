"""The HTML report: one file that needs no other."""

from collections.abc import Sequence
from html import escape

from app.arrays import F32
from app.bench.headlines import networks_of
from app.bench.plots import plot_errors, plot_scaling, plot_stages
from app.bench.records import Json
from app.evaluation.html import LAYERS, embed_pictures, error_cells, fill_page, html_table, layer_heads
from app.evaluation.metrics import METRICS
from app.evaluation.picture_errors import AMBIENT
from app.evaluation.tables import format_number
from app.evaluation.timing import FRAME


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
    images = {scene: embed_pictures(images) for scene, images in pictures.items()}
    return fill_page(
        "app.bench", "report.html", images, machine=_machine(results), headlines=_headlines(results["headlines"]),
        error_size=f"{width}×{height}", scatter=plot_errors(results), stages=plot_stages(results),
        scenes="\n".join(map(_scene, results["scenes"])),
        scaling=_scaling(results["scaling"]) if "scaling" in results else "")


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


def _headlines(rows: Sequence[Json]) -> str:
    scenes = list(dict.fromkeys(name for row in rows for name in row["scenes"]))
    body = []
    for row in rows:
        for key, title in (("speed_up", "speed-up at equal error"), ("error_ratio", "error ratio at equal time")):
            ratios = [_ratio(row["scenes"][s][key]) if s in row["scenes"] else "–" for s in scenes]
            body.append([f"{row['model']} against {row['against']}: {title}", _ratio(row[key]), *ratios])
    return html_table(["", "mean", *scenes], body) if rows else "<p>No network was measured beside a baseline.</p>"


def _scene(scene: Json) -> str:
    reference, name = scene["reference"], escape(scene["name"])
    first = escape(next(iter(networks_of(scene)), AMBIENT))
    noise = ", ".join(f"{layer} {value:.2%}" for layer, value in reference["noise"].items() if value is not None)
    about = (f"{scene['triangles']} triangles, {scene['lights']} light{'s' * (scene['lights'] != 1)}"
             + (f" (lighting {scene['lighting']})" if scene["lighting"] else "")
             + (f"; full-material reference of {reference['spp']} samples per pixel" if "spp" in reference else "")
             + (f", noise {noise}" if noise else "") + "".join(f"; {notice}" for notice in reference["notices"]))
    return (f'<h2>{name}</h2><p class=note>{escape(about)}</p><div data-scene="{name}" data-first="{first}">'
            '<div class=pair><img alt=right><img class=over alt=left></div><div class=controls><select></select>'
            '<input type=range value=50><select></select></div></div>' + _errors(scene) + _times(scene))


def _errors(scene: Json) -> str:
    entries = [(c["label"], c["stages"][FRAME]["median"], c["errors"]) for c in scene["configurations"] if c["errors"]]
    entries.append((AMBIENT, None, scene["ambient"]["errors"]))
    entries += [(f"{b['name']}, {b['spp']} spp", b["ms"], b["errors"]) for b in scene["baselines"]]
    head = ["", "ms", *(metric.title for _ in LAYERS for metric in METRICS.values())]
    body = [[label, "–" if ms is None else format_number(ms), *error_cells(errors, LAYERS)]
            for label, ms, errors in entries]
    return "<h3>Errors</h3>" + html_table(head, body, "<tr><td colspan=2>" + layer_heads(LAYERS))


def _times(scene: Json) -> str:
    parts = ["<h3>Times</h3>"]
    for size in dict.fromkeys(tuple(c["size"]) for c in scene["configurations"]):
        entries = [c for c in scene["configurations"] if tuple(c["size"]) == size]
        names = list(dict.fromkeys(n for c in entries for n in c["stages"] if n != FRAME))
        body = [[n, *(_spread(c["stages"].get(n)) for c in entries)] for n in [*names, FRAME]]
        starts = [c["cold_start"] for c in entries]
        if any(starts):
            body += [[title, *(format_number(start[key]) if start else "–" for start in starts)]
                     for title, key in (("start-up s", "startup_s"), ("peak memory MB", "peak_mb"))]
        heads = [c["label"] + (f" ({c['grid'][0]}×{c['grid'][1]})" if c["grid"] else "") for c in entries]
        parts.append(html_table([f"{size[0]}×{size[1]}", *heads], body))
    return "".join(parts)


def _scaling(scaling: Json) -> str:
    note = (f"Measured with {scaling['model']} in a generated hall with a moving block. Each stage's median time is "
            "fitted with a power of the quantity; the standard error of the exponent follows it. Surfels and width are "
            "swept with networks made for the purpose, radiosity and BCNN.")
    parts = ["<h2>How cost scales</h2>", f"<p class=note>{escape(note)}</p>", plot_scaling(scaling["sweeps"])]
    for quantity, data in scaling["sweeps"].items():
        body = [[name, *map(format_number, s["ms"]),
                 "–" if s["exponent"] is None else f"{s['exponent']:.2f} ± {s['error']:.2f}"]
                for name, s in data["stages"].items()]
        parts.append(html_table([quantity, *map(str, data["counts"]), "exponent"], body))
    return "".join(parts)


def _ratio(ratio: Json) -> str:
    return f"{ratio['bound']}{format_number(ratio['value'])}×"


def _spread(spread: Json | None) -> str:
    return "–" if spread is None else f"{format_number(spread['median'])} ({format_number(spread['p95'])})"
