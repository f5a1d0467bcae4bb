"""Packages that load their public names when they are first used."""

from __future__ import annotations

import ast
import importlib
import sys
from pathlib import Path

import pytest

import sysid

ROOT = Path(sysid.__file__).resolve().parents[1]
#: Packages of the program that do so.
LAZY_PACKAGES = [
    importlib.import_module(".".join(path.parent.relative_to(ROOT).parts))
    for path in sorted(ROOT.glob("sysid/**/__init__.py"))
    if "= lazy_names(" in path.read_text(encoding="utf-8")
]

LAZY = """
from sysid.lazy_names import lazy_names

ready = True
__getattr__, __dir__ = lazy_names(__name__, {"answer": "lazy_example.home"}, submodules=("side",))
"""


@pytest.fixture
def example(tmp_path, monkeypatch):
    folder = tmp_path / "lazy_example"
    folder.mkdir()
    (folder / "__init__.py").write_text(LAZY, encoding="utf-8")
    (folder / "home.py").write_text("answer = 42\nother = 1\n", encoding="utf-8")
    (folder / "side.py").write_text("", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield importlib.import_module("lazy_example")
    for name in [n for n in sys.modules if n.split(".")[0] == "lazy_example"]:
        del sys.modules[name]


def test_a_home_is_loaded_at_first_use(example) -> None:
    assert "lazy_example.home" not in sys.modules
    assert example.answer == 42
    assert "lazy_example.home" in sys.modules


def test_a_submodule_is_a_name_too(example) -> None:
    assert "lazy_example.side" not in sys.modules
    assert example.side is sys.modules["lazy_example.side"]


def test_another_name_of_a_home_is_not_the_package_s(example) -> None:
    with pytest.raises(AttributeError, match="module 'lazy_example' has no attribute 'other'"):
        _ = example.other
    with pytest.raises(ImportError, match="cannot import name 'other'"):
        exec("from lazy_example import other")


def test_names_are_listed_before_they_are_loaded(example) -> None:
    assert {"answer", "side", "ready"} <= set(dir(example))
    assert "lazy_example.home" not in sys.modules


@pytest.mark.parametrize("package", LAZY_PACKAGES, ids=lambda p: p.__name__)
def test_every_public_name_loads_and_is_listed(package) -> None:
    for name in package.__all__:
        home = package._HOMES.get(name)
        module = importlib.import_module(home or f"{package.__name__}.{name}")
        assert getattr(package, name) is (getattr(module, name) if home else module)
    assert set(package.__all__) <= set(dir(package))
    assert list(dir(package)) == sorted(set(dir(package)))


@pytest.mark.parametrize("package", LAZY_PACKAGES, ids=lambda p: p.__name__)
def test_type_checkers_read_the_same_homes(package) -> None:
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    guards = [n for n in tree.body if isinstance(n, ast.If)]
    imports = [line for guard in guards for line in guard.body if isinstance(line, ast.ImportFrom)]
    homes = {alias.name: line.module for line in imports for alias in line.names}
    assert {name: home for name, home in homes.items() if home != package.__name__} == package._HOMES
    assert set(homes) == set(package.__all__)
