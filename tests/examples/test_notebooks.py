"""The notebooks run from top to bottom on the shipped campaigns, in their order, and show figures."""

from __future__ import annotations

import os
import re
import shutil
import tomllib
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
#: Figures that a notebook shows at least.
FIGURES = {"0": 4, "1": 1, "2": 5, "3": 4, "4": 4, "5": 1, "6": 2, "7": 1}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A folder for the notebooks with a copy of their campaigns, so that results are written elsewhere."""
    root = tmp_path_factory.mktemp("notebooks")
    for campaign in ("linear_truck", "vehicles"):
        shutil.copytree(ROOT / "examples" / campaign, root / "examples" / campaign)
    shutil.copytree(ROOT / "data", root / "data")
    return root / "examples"


def test_there_are_notebooks():
    assert [n.name[0] for n in NOTEBOOKS] == list(FIGURES)


def test_the_first_repeats_are_the_campaign_less_the_others():
    folder = ROOT / "examples" / "linear_truck"
    whole, short = (
        tomllib.loads((folder / f"{n}.toml").read_text(encoding="utf-8")) for n in ("campaign", "first_repeats")
    )
    for kind in ("plank_drop", "bump_run"):
        assert short["tests"][kind] == [e for e in whole["tests"][kind] if e["file"].endswith("1.csv")]
    for table in (whole, short):
        table["campaign"].pop("title")
        del table["tests"]["plank_drop"], table["tests"]["bump_run"]
    assert whole == short


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_outputs_are_stored_and_say_nothing_of_a_machine(path):
    outputs = [o for c in nbformat.read(path, 4).cells for o in c.get("outputs", [])]
    assert len([o for o in outputs if "image/png" in o.get("data", {})]) >= FIGURES[path.name[0]]
    assert {o.output_type for o in outputs} <= {"stream", "display_data", "execute_result"}
    assert [o.text for o in outputs if o.output_type == "stream" and o.name == "stderr"] == []
    texts = [str({k: v for k, v in o.get("data", {}).items() if k != "image/png"}) + o.get("text", "") for o in outputs]
    assert [t for t in texts if re.search(r"(?<![\w.])/(home|root|tmp|Users|work)/", t)] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_only_public_names(path):
    code = "\n".join(c.source for c in nbformat.read(path, 4).cells if c.cell_type == "code")
    assert not re.search(r"\._[a-z]", code)
    assert set(re.findall(r"^(?:from|import) (sysid[\w.]*)", code, re.MULTILINE)) == {"sysid"}


# Jupyter's own packages warn about one another.
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_runs(path, folder, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    notebook = nbformat.read(path, 4)
    NotebookClient(
        notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    outputs = [o for c in notebook.cells if c.cell_type == "code" for o in c.outputs]
    pictures = [o for o in outputs if "image/png" in o.get("data", {})]
    assert len(pictures) >= FIGURES[path.name[0]]
    assert [o.get("text") for o in outputs if o.output_type == "stream" and o.get("name") == "stderr"] == []
