"""Every third-party package that is imported is declared, and every declared one is imported."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

#: Distributions whose import has another name.
DISTRIBUTION = {"griffe": "griffelib", "sksundae": "scikit-sundae", "can": "python-can"}
#: Declared, and never imported by name: who loads them.
LOADED_BY_OTHERS = {
    "auditwheel": "command",
    "cyclonedx-bom": "command",
    "h5netcdf": "xarray, to write netCDF",
    "ipykernel": "nbclient, to run notebooks",
    "mkdocs-material": "mkdocs",
    "mkdocstrings": "mkdocs",
    "mypy": "command",
    "pip-audit": "command",
    "pip-licenses": "command",
    "pandas-stubs": "mypy",
    "pytest-xdist": "pytest",
    "ruff": "command",
    "setuptools": "pip, to install the package",
    "uv": "command",
    "wheel": "command",
    "ziglang": "command",
}
#: Used where somebody has it, and replaced or left out where not.
USED_WHERE_INSTALLED = {"arviz"}


def imports(source: str) -> set[str]:
    """Distributions that a module imports, inside functions too; not the standard library."""
    modules: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            modules.add(node.module.split(".")[0])
    return {DISTRIBUTION.get(m, m.replace("_", "-")) for m in modules - set(sys.stdlib_module_names)}


def imported_below(*folders: str) -> set[str]:
    """Distributions imported below folders of the repository, less the repository's own modules."""
    paths = [p for folder in folders for p in (ROOT / folder).rglob("*.py")]
    everything = [
        p for folder in ("sysid", "tests", "benchmarks", "studies", "tools") for p in (ROOT / folder).rglob("*.py")
    ]
    ours = {"sysid", "tests", "benchmarks", "studies", "tools"} | {p.stem.replace("_", "-") for p in everything}
    found = set().union(*(imports(p.read_text(encoding="utf-8")) for p in paths))
    return found - (ours - declared_everywhere())


def names(requirements: list[str]) -> set[str]:
    """Names of requirements, less the package itself."""
    return {re.split(r"[\[<>=!~; ]", r, maxsplit=1)[0].lower().replace("_", "-") for r in requirements} - {
        "truck-sysid"
    }


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def declared_everywhere() -> set[str]:
    extras = project()["optional-dependencies"]
    return names(project()["dependencies"]).union(*(names(extra) for extra in extras.values()))


def test_the_package_imports_what_it_declares():
    extras = project()["optional-dependencies"]
    formats = ("opencrg", "mdf", "tdms", "parquet", "excel", "lvm", "uff", "can")
    optional = USED_WHERE_INSTALLED.union(*(names(extras[extra]) for extra in ("cluster", *formats)))
    assert imported_below("sysid") - optional == names(project()["dependencies"]) - LOADED_BY_OTHERS.keys()


def test_everything_imported_is_declared():
    # Scripts beside reference data say themselves what they were made with.
    scripts = set().union(*(imports(p.read_text(encoding="utf-8")) for p in (ROOT / "tests/data").rglob("*.py")))
    undeclared = imported_below("sysid", "tests", "benchmarks", "studies", "docs", "tools") - declared_everywhere()
    assert undeclared - USED_WHERE_INSTALLED - scripts == set()


def test_everything_declared_is_used():
    used = imported_below("sysid", "tests", "benchmarks", "studies", "docs", "tools", "examples")
    assert declared_everywhere() - used == set(LOADED_BY_OTHERS)


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import os, lineax.internal\n", {"lineax"}),
        ("def f():\n    from arviz_stats.base import array_stats\n", {"arviz-stats"}),
        ("from .road import plane\n", set()),
    ],
)
def test_imports_are_seen(source: str, found: set[str]):
    assert imports(source) == found
