"""Every public name says what it is, and what it raises itself."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2] / "sysid"
SOURCES = sorted(ROOT.rglob("*.py"))
Definition = ast.FunctionDef | ast.ClassDef


def public(source: str) -> Iterator[tuple[str, Definition]]:
    """Public classes, functions and methods; what is inside of private ones is private too."""

    def walk(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, Definition]]:
        for node in body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
                yield prefix + node.name, node
                if isinstance(node, ast.ClassDef):
                    yield from walk(node.body, f"{prefix}{node.name}.")

    yield from walk(ast.parse(source).body, "")


def unsaid(source: str) -> list[str]:
    """Names without a docstring, or with one that leaves out the errors that they raise themselves."""
    found = []
    for name, node in public(source):
        text = ast.get_docstring(node) or ""
        if not text:
            found.append(name)
        if isinstance(node, ast.FunctionDef):
            calls = [n.exc for n in ast.walk(node) if isinstance(n, ast.Raise) and isinstance(n.exc, ast.Call)]
            raised = {c.func.id for c in calls if isinstance(c.func, ast.Name) and c.func.id.endswith("Error")}
            found += [f"{name}: {error}" for error in sorted(raised) if error not in text]
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_public_names_have_docstrings_that_name_their_errors(path: Path) -> None:
    assert unsaid(path.read_text(encoding="utf-8")) == []


def test_what_is_left_out_is_found() -> None:
    source = (
        'def good():\n    """Raises ValueError."""\n    raise ValueError("x")\n'
        'def bad():\n    """Words."""\n    raise ValueError("x")\n'
        'class Shown:\n    """Words."""\n    def method(self):\n        pass\n    def _own(self):\n        pass\n'
        "class _Hidden:\n    def method(self):\n        pass\n"
    )
    assert unsaid(source) == ["bad: ValueError", "Shown.method"]
