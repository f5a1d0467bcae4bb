"""Every module of the studies can be imported: names that moved are missed where a study runs once a month."""

import importlib
import pkgutil

import pytest

import studies

MODULES = sorted(m.name for m in pkgutil.walk_packages(studies.__path__, "studies."))


@pytest.mark.parametrize("name", MODULES)
def test_module_of_a_study_can_be_imported(name: str) -> None:
    importlib.import_module(name)
