"""Write docs/api.md from the docstrings of what ``import afterglow`` offers."""

import inspect
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from app import api
from app.io.atomic_files import write_text

PAGE = ROOT / "docs" / "api.md"
HEAD = """# API

Everything that `import afterglow` offers; [python.md](python.md) shows its use. This page is written by
`python scripts/write_api_page.py` from the docstrings.
"""


def make_page() -> str:
    """The page's text."""
    return "\n".join([HEAD, *(_describe(name, getattr(api, name)) for name in api.__all__)])


def _describe(name: str, item: Any) -> str:
    parts = [_entry("##", name, item)]
    if inspect.isclass(item) and item.__module__.startswith("app.api"):
        for member, value in vars(item).items():
            function = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
            if not member.startswith("_") and callable(function) and function.__doc__:
                parts.append(_entry("###", f"{name}.{member}", value))
    return "\n".join(parts)


def _entry(level: str, name: str, item: Any) -> str:
    text = inspect.cleandoc(item.__doc__ or "")
    if isinstance(item, property):
        return f"{level} `{name}`\n\n```text\n{text}\n```\n"
    return f"{level} `{name}`\n\n```python\n{name}{_parameters(item)}\n```\n\n```text\n{text}\n```\n"


def _parameters(item: Any) -> str:
    """Names and defaults; the types are in the docstring."""
    signature = inspect.signature(getattr(item, "__func__", item))
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in signature.parameters.values() if p.name != "self"]
    return str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))


if __name__ == "__main__":
    write_text(PAGE, make_page())
