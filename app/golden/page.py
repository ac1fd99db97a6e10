"""The page of a check: golden, current and difference map of broken stages, and all numbers, in a single file."""

from collections import defaultdict
from html import escape
from importlib import resources
from string import Template

import numpy as np

from app.arrays import F32, Bytes, Floats
from app.errors import MissingExtraError
from app.evaluation.html import data_uri
from app.evaluation.metrics import flip_map
from app.golden.check import Report
from app.golden.comparison import Finding, radiance, texel_difference
from app.golden.tolerance import PICTURES
from app.io.image import srgb_encode, to_8bit

MAX_ILLUSTRATED = 40  # broken resources with pictures; later ones mostly follow from them
MAX_SCALED = 6e4      # larger values, such as the distance of an empty shadow texel, do not affect the brightness


def page(report: Report) -> str:
    """The page as text, with the first broken stage of each case on top."""
    broken = _by_depth(report.broken)
    first = f"{broken[0].stage or broken[0].resource} of {broken[0].case} broke first" if broken else "all is well"
    notes = [*report.origins, *(f"{case}: the goldens come from {origin}, so the wider tolerance applies"
                                for case, origin in report.foreign.items())]
    if len(broken) > MAX_ILLUSTRATED:
        notes.append(f"Pictures of the first {MAX_ILLUSTRATED} of {len(broken)} broken resources.")
    template = Template((resources.files("app.golden") / "page.html").read_text("utf-8"))
    return template.substitute(title=escape(first), origins="<br>".join(map(escape, notes)),
                               broken="\n".join(map(_section, broken[:MAX_ILLUSTRATED])),
                               rows="\n".join(map(_row, report.findings)))


def _by_depth(broken: list[Finding]) -> list[Finding]:
    """The first broken stages of all cases, then the second ones, and so on."""
    stages: dict[str, list[str]] = defaultdict(list)
    for f in broken:
        if f.stage not in stages[f.case]:
            stages[f.case].append(f.stage)
    return sorted(broken, key=lambda f: stages[f.case].index(f.stage))


def _section(f: Finding) -> str:
    names = ("first run", "second run") if f.verdict == "unsteady" else ("golden", "now")
    figures = [_figure(picture(image, f.golden if f.golden is not None else image, f.resource), name)
               for image, name in zip((f.golden, f.current), names, strict=True) if image is not None]
    if f.golden is not None and f.current is not None and f.golden.shape == f.current.shape:
        figures.append(_figure(*difference_map(f)))
    title = " · ".join(filter(None, (f.stage, f.resource, f.case)))
    frame = f", frame {f.frame}" if f.frame else ""
    return (f"<h2>{escape(title)}</h2>\n<p>{f.verdict}{frame}: {escape(_numbers(f))}</p>\n"
            f"<div class=row>{''.join(figures)}</div>")


def _numbers(f: Finding) -> str:
    """The distances of a finding with their bounds."""
    if f.tolerance is None or not f.frame:
        return "not compared"
    d, t = f.distance, f.tolerance
    text = f"largest difference {d.difference:.3g}, {d.share:.2%} of the texels off ({t.share:.2%} allowed)"
    return text if d.flip is None else f"{text}, FLIP {d.flip:.4f} ({t.flip:g} allowed)"


def _figure(uri: str, caption: str) -> str:
    return f'<figure><img src="{uri}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'


def _row(f: Finding) -> str:
    d, t = f.distance, f.tolerance
    cells = [f.case, f.stage or "–", f.resource, f.verdict, str(f.frame or "–"), f"{d.difference:.2g}"]
    cells += [f"{t.difference:g}", f"{d.share:.2%}", f"{t.share:.2%}"] if t else ["–"] * 3
    cells += [f"{d.flip:.4f}", f"{t.flip:g}"] if t and d.flip is not None else ["–"] * 2
    return f"<tr{'' if f.ok else ' class=broken'}>" + "".join(f"<td>{escape(cell)}" for cell in cells) + "</tr>"


def picture(image: F32, like: F32, resource: str) -> str:
    """An image with brightness scaled to suit ``like``; signed values around grey, others from black."""
    if resource == "display":
        return _uri(to_8bit(image[..., :3]))
    values, reference = _rgb(image), _rgb(like)
    scaled = np.abs(reference[np.abs(reference) < MAX_SCALED])
    white = max(float(np.percentile(scaled, 99)) if scaled.size else 1.0, 1e-30)
    return _uri(to_8bit(0.5 + 0.5 * values / white if (reference < 0).any() else srgb_encode(values / white)))


def difference_map(finding: Finding) -> tuple[str, str]:
    """The HDR-FLIP map of a picture, or else each texel's difference at half brightness where it equals the tolerance.

    Returns the data URI and the name of the map.
    """
    golden, current = finding.golden, finding.current
    assert golden is not None and current is not None and finding.tolerance is not None
    if finding.resource in PICTURES:
        try:
            return _ramp(flip_map(radiance(current, finding.resource), radiance(golden, finding.resource))), "FLIP"
        except MissingExtraError:
            pass
    limit = max(finding.tolerance.difference, 1e-6)
    return _ramp(np.minimum(texel_difference(current, golden), 2 * limit) / (2 * limit)), "difference"


def _rgb(image: F32) -> F32:
    """Three finite components: one becomes grey, two become red and green."""
    image = np.nan_to_num(image, nan=0.0)
    if image.shape[2] == 1:
        return np.repeat(image, 3, axis=2)
    return np.pad(image, ((0, 0), (0, 0), (0, 1))) if image.shape[2] == 2 else image[..., :3]


def _ramp(values: Floats) -> str:
    """Values from 0 to 1 as black, red, yellow, white."""
    return _uri(to_8bit(3 * values[..., None] - np.arange(3)))


def _uri(pixels: Bytes) -> str:
    return data_uri(pixels, "png", optimize=True)
