"""Golden images: what every pass writes for a catalogue of generated scenes, kept and compared."""

from app.golden.compare import Finding, Report, check, draw, orphan_cases, update
from app.golden.scenes import Case, catalogue

__all__ = ["Case", "Finding", "Report", "catalogue", "check", "draw", "orphan_cases", "update"]
