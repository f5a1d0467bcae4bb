"""Imports run downward only, and the light packages load nothing heavy: from the source, and from a fresh process."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import sysid

ROOT = Path(sysid.__file__).resolve().parent

#: From the bottom up; packages on one level do not know each other.
LEVELS = (
    {"errors", "limits"},
    {"display", "folder_lock", "output_folder", "runtime", "tabular"},
    {"campaign"},
    {"sdof", "road"},
    {"vehicle_model"},
    {"estimation"},
    {"posterior"},
    {"prediction", "selftest", "validation"},
    {"plot"},
    {"export"},
    {"report"},
    {"workflow"},
    {"cli"},
)
LEVEL = {name: number for number, names in enumerate(LEVELS) for name in names}

JAX_PACKAGES = {"runtime", "vehicle_model", "estimation", "posterior", "prediction"}


def imported_modules(source: str, package: str) -> set[str]:
    """Absolute names of everything a module imports, inside functions too; relative imports resolved in `package`."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")
            base = ".".join(parts[: len(parts) - node.level + 1]) if node.level else ""
            origin = ".".join(p for p in (base, node.module or "") if p)
            found.add(origin)
            # `from sysid import road` names a package, not an attribute.
            found |= {f"{origin}.{alias.name}" for alias in node.names}
    return found


def layer(path: Path) -> str:
    """The package (or single module) directly under `sysid` that a file belongs to."""
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def targets(modules: set[str]) -> set[str]:
    """Names directly under `sysid` among imported modules."""
    return {m.split(".")[1] for m in modules if m.startswith("sysid.")} & set(LEVEL)


def upward(own: str, modules: set[str]) -> set[str]:
    """Imports that do not run downward from package `own`."""
    return {t for t in targets(modules) if t != own and LEVEL[t] >= LEVEL[own]}


SOURCES = sorted(p for p in ROOT.rglob("*.py") if p != ROOT / "__init__.py")


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_downward(path: Path):
    own = layer(path)
    assert own in LEVEL, f"{own} has no place among the layers"
    package = ".".join(["sysid", *path.relative_to(ROOT).parts[:-1]])
    modules = imported_modules(path.read_text(encoding="utf-8"), package)
    assert upward(own, modules) == set()
    roots = {m.split(".")[0] for m in modules}
    if own not in ("plot", "report"):
        assert "matplotlib" not in roots
    if own not in JAX_PACKAGES:
        assert roots & {"jax", "optimistix", "equinox", "lineax"} == set()


@pytest.mark.parametrize(
    ("own", "source"),
    [
        ("road", "def f():\n    from sysid.vehicle_model import contact\n"),
        ("road", "import sysid.sdof.results\n"),
        ("estimation", "if TYPE_CHECKING:\n    from sysid import posterior\n"),
        ("campaign", "from ..report import page\n"),
    ],
)
def test_an_upward_import_is_seen(own: str, source: str):
    assert upward(own, imported_modules(source, f"sysid.{own}")) != set()


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import sysid", ("matplotlib", "emcee", "jax", "numpy", "pandas")),
        ("import sysid.campaign", ("matplotlib", "emcee", "jax")),
        ("import sysid.sdof, sysid.road", ("matplotlib", "emcee", "jax")),
        ("import sysid.vehicle_model, sysid.estimation", ("matplotlib", "emcee")),
    ],
)
def test_light_packages_load_nothing_heavy(statement: str, absent: tuple[str, ...]):
    code = f"import sys\n{statement}\nprint(*sorted(set({absent!r}) & sys.modules.keys()))"
    result = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_public_names_are_loaded_when_first_used():
    assert sysid.read_campaign.__module__.startswith("sysid.campaign")
    assert set(sysid.__all__) <= set(dir(sysid))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = sysid.nonsense
