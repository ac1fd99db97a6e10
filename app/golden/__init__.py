"""Golden images: the output of every pass for a catalogue of scenes, stored and compared."""

from app.golden.case import Case, Picture
from app.golden.catalogue import catalogue
from app.golden.check import Report, check, orphan_cases
from app.golden.comparison import Finding
from app.golden.page import page
from app.golden.scene_case import SceneCase, Shot
from app.golden.update import update
from app.golden.user_catalogue import read_catalogue

__all__ = ["Case", "Finding", "Picture", "Report", "SceneCase", "Shot", "catalogue", "check", "orphan_cases",
           "page", "read_catalogue", "update"]
