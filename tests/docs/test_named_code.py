"""Files, modules and functions that documents and docstrings name are there."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SOURCES = [p for folder in ("sysid", "studies") for p in sorted((ROOT / folder).rglob("*.py"))]
#: Files of the repository, each with a slash before it, so that the end of a path can be looked for.
FILES = "\n".join(
    f"/{p.relative_to(ROOT)}"
    for folder in ("sysid", "studies", "tests", "docs", "tools", "benchmarks")
    for p in (ROOT / folder).rglob("*")
    if p.suffix in (".py", ".h", ".cpp", ".md", ".html", ".svg")
)
FILES += "\n/calibrate.py\n"
#: What the pages on where to add something would add.
EXAMPLES = {"sysid/prediction/comfort.py", "sysid/logs/formats/rpc.py", "sysid/export/adams.py"}


def exists(name: str) -> bool:
    """Whether a dotted name is a module, or a name in one; members of records too."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ImportError:
            continue
        for part in parts[count:]:
            if part in getattr(found, "__annotations__", {}):
                return True
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def missing_files(text: str) -> set[str]:
    """Names of source files in backticks, whole or the end of a path, that no file has."""
    names = set(re.findall(r"`([\w./-]+\.(?:py|h|cpp))`", text))
    return {n for n in names - EXAMPLES if f"/{n}\n" not in FILES}


def missing_names(text: str) -> set[str]:
    """Dotted names below the package that do not exist."""
    return {n for n in re.findall(r"(?<![\w./-])sysid(?:\.\w+)+", text) if not exists(n)}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_code_that_a_page_names_is_there(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert missing_files(text) == set()
    assert missing_names(text) == set()


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_code_that_a_docstring_names_is_there(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert {n for n in re.findall(r":\w+:`~?(sysid\.[\w.]+)`", text) if not exists(n)} == set()
    assert {n for n in re.findall(r"\b(?:sysid|docs|tests|studies)/[\w/.-]+\.(?:py|md|h|cpp)\b", text)
            if not (ROOT / n).is_file()} == set()  # fmt: skip


def test_readme_and_picture_have_every_package() -> None:
    packages = {p.parent.name for p in (ROOT / "sysid").glob("*/__init__.py")}
    picture = (ROOT / "docs" / "architecture" / "rooms.svg").read_text(encoding="utf-8")
    shown = {name for text in re.findall(r'font-weight="bold">([^<]+)<', picture) for name in re.findall(r"\w+", text)}
    assert packages - shown == set()
    table = PAGES[0].read_text(encoding="utf-8").split("## Where things are")[1]
    assert {name for name in packages if f"`sysid/{name}`" not in table} == set()


def test_what_moved_is_seen() -> None:
    assert missing_files("`suspension.py`, `vehicle_model/suspension.py`, `sysid/estimation/laws.py`, `model.py`") == {
        "sysid/estimation/laws.py",
        "model.py",
    }
    assert missing_names("sysid.road.scan.analyse_scan, sysid.road.nothing, `sysid.Nothing`") == {
        "sysid.road.nothing",
        "sysid.Nothing",
    }
