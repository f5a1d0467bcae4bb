"""Run the notebooks of `examples/` and store them with their outputs: ``python docs/make_examples.py [NUMBER ...]``.

They run in a copy of their campaigns, so that nothing is written into the checkout but the notebooks themselves.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from copy import deepcopy
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]


def main(numbers: list[str]) -> None:
    """Renew the notebooks whose names begin with `numbers`, all of them for none."""
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    with tempfile.TemporaryDirectory() as scratch:
        examples = Path(scratch) / "examples"
        shutil.copytree(ROOT / "data", Path(scratch) / "data")
        for campaign in ("linear_truck", "vehicles"):
            shutil.copytree(ROOT / "examples" / campaign, examples / campaign)
        for path in sorted((ROOT / "examples").glob("*.ipynb")):
            if numbers and path.name[0] not in numbers:
                continue
            notebook = nbformat.read(path, 4)
            # Without the version of Python that the kernel adds.
            metadata = deepcopy(notebook.metadata)
            resources = {"metadata": {"path": str(examples)}}
            before = _processor_s()
            NotebookClient(notebook, timeout=1800, record_timing=False, resources=resources).execute()
            sys.stdout.write(f"{path.name}: {_processor_s() - before:.0f} s of processor time\n")
            sys.stdout.flush()
            notebook.metadata = metadata
            nbformat.write(notebook, path)


def _processor_s() -> float:
    """Processor time of all children that have ended [s]."""
    times = os.times()
    return times.children_user + times.children_system


if __name__ == "__main__":
    main(sys.argv[1:])
