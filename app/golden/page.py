"""The page of a failed check: golden, current, difference map and numbers, in one file that needs no other."""

from __future__ import annotations

from collections import defaultdict
from html import escape
from importlib import resources
from string import Template

from app.golden.check import Report
from app.golden.comparison import Finding
from app.golden.visualize import difference_map, picture

MAX_SHOWN = 40  # broken resources with pictures; the others follow from them


def page(report: Report) -> str:
    """The page as text, the first broken stage of each case on top."""
    broken = _by_depth(report.broken)
    first = f"{broken[0].stage or broken[0].resource} of {broken[0].case} broke first" if broken else "all is well"
    notes = [*report.origins, *(f"{case}: the goldens come from {origin}, so the wider tolerance holds"
                                for case, origin in report.foreign.items())]
    if len(broken) > MAX_SHOWN:
        notes.append(f"Pictures of the first {MAX_SHOWN} of {len(broken)} broken resources.")
    template = Template((resources.files("app.golden") / "page.html").read_text("utf-8"))
    return template.substitute(title=escape(first), origins="<br>".join(map(escape, notes)),
                               broken="\n".join(map(_section, broken[:MAX_SHOWN])),
                               rows="\n".join(map(_row, report.findings)))


def _by_depth(broken: list[Finding]) -> list[Finding]:
    """The first broken stage of every case, then the second ones, and so on; within a stage, the worst first."""
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
    return (f"<h2>{escape(title)}</h2>\n<p>{f.verdict}{frame}: {escape(numbers(f))}</p>\n"
            f"<div class=row>{''.join(figures)}</div>")


def numbers(f: Finding) -> str:
    """The distances of a finding, with what is allowed."""
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
