"""Draws cases and compares them with a folder of goldens."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from app.golden.case import Case
from app.golden.comparison import Finding, compare
from app.golden.store import ORIGIN, file_name, names, read_origin, read_picture
from app.golden.tolerance import tolerance


@dataclass(frozen=True)
class Report:
    """All findings of one check, those of each case in the order of its stages.

    Attributes
    ----------
    origins : list of str
        What drew the cases now: GL renderer and version, and onnxruntime's version.
    foreign : dict of str to str
        Cases whose goldens come from another origin, with that origin; the wider tolerance applies to them.
    """

    findings: list[Finding]
    origins: list[str]
    foreign: dict[str, str]

    @property
    def broken(self) -> list[Finding]:
        return [f for f in self.findings if not f.ok]


def check(cases: Iterable[Case], folder: Path, progress: Callable[[str], None] = lambda _: None) -> Report:
    """Draw each case twice, require equal bits, and compare with the goldens in ``folder``.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of each case before it is drawn.

    Raises
    ------
    SceneError
        When a golden can't be read.
    """
    findings: list[Finding] = []
    origins: dict[str, None] = {}
    foreign: dict[str, str] = {}
    for case in cases:
        progress(case.name)
        golden = read_origin(folder / case.name)
        origins[case.origin()] = None
        if golden not in (None, case.origin()):
            foreign[case.name] = str(golden)
        findings += _check_case(case, folder / case.name, case.name in foreign)
        if golden is None:
            findings.append(Finding(case.name, "", ORIGIN, "missing"))
    return Report(findings, list(origins), foreign)


def orphan_cases(folder: Path, known: Iterable[str]) -> list[Finding]:
    """Entries of ``folder`` that belong to no case of the catalogue."""
    return [Finding(name, "", name, "orphan") for name in names(folder) if name not in set(known)]


def _check_case(case: Case, folder: Path, foreign: bool) -> list[Finding]:
    pictures, again = case.draw(folder), case.draw(folder)
    findings = [compare(case.name, p, other, read_picture(folder, p.resource), tolerance(p.stage, foreign))
                for p, other in zip(pictures, again, strict=True)]
    known = {ORIGIN, *(file_name(p.resource) for p in pictures)}
    return findings + [Finding(case.name, "", name, "orphan") for name in names(folder) if name not in known]
