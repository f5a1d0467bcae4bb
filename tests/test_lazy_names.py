"""Packages that load their public names when they are first used."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import sysid

ROOT = Path(sysid.__file__).resolve().parent
STUBS = sorted(ROOT.rglob("__init__.pyi"))


def package(stub: Path) -> str:
    """Name of the package that a stub describes."""
    return ".".join(("sysid", *stub.parent.relative_to(ROOT).parts))


def homes(stub: Path) -> dict[str, str]:
    """Module of every name in a stub; a submodule is its own."""
    lines = [n for n in ast.parse(stub.read_text(encoding="utf-8")).body if isinstance(n, ast.ImportFrom)]
    own = package(stub)
    return {a.name: f"{own}.{line.module}" if line.module else f"{own}.{a.name}" for line in lines for a in line.names}


@pytest.mark.parametrize("stub", STUBS, ids=package)
def test_every_name_of_a_stub_is_the_package_s(stub) -> None:
    found, expected = importlib.import_module(package(stub)), homes(stub)
    assert expected
    assert set(dir(found)) == set(found.__all__) == set(expected)
    for name, home in expected.items():
        module = importlib.import_module(home)
        assert getattr(found, name) is (module if home == f"{package(stub)}.{name}" else getattr(module, name))
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = found.no_such_name


def test_a_name_loads_its_module_and_no_other() -> None:
    code = (
        "import sys, sysid; before = 'sysid.campaign.read' in sys.modules; sysid.read_campaign; "
        "print(before, 'sysid.campaign.read' in sys.modules, 'sysid.workflow.calibration' in sys.modules)"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.split() == ["False", "True", "False"]
