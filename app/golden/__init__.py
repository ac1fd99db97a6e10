"""Golden images: what every pass writes for a catalogue of generated scenes, kept and compared."""

from app.golden.check import Finding, check, draw, update
from app.golden.scenes import Case, catalogue

__all__ = ["Case", "Finding", "catalogue", "check", "draw", "update"]
