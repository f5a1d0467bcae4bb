"""Results of a fleet that somebody changed: status, tables and population end in what is left, or in one sentence."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fleet_results import write_fleet_results
from split_cases import first_then_long

from studies.damages.files import FILE_DAMAGES
from studies.damages.forgeries import _LEAVES, _places, array_changed
from sysid import array_file
from sysid.cli.fleet import status_blocks
from sysid.errors import SysidError
from sysid.fleet.assembly import assemble
from sysid.fleet.draws import RECORD_FILE
from sysid.fleet.hierarchy import HyperPriors
from sysid.fleet.index import write_index
from sysid.fleet.key import result_digest
from sysid.fleet.loads import population_loads
from sysid.fleet.members import members
from sysid.fleet.outcome import OUTCOME_FILE, RESULT_FILE
from sysid.fleet.read import read_fleet
from sysid.fleet.running import campaign_output
from sysid.fleet.status import rows_on_disk

KIND = "short truck"
CHANGED = "T2-1"


@pytest.fixture
def fleet(tmp_path: Path) -> tuple[Path, Path]:
    return write_fleet_results(tmp_path, trucks=4)


def looked_at(folder: Path, output: Path) -> None:
    """What the commands of a fleet read of the results; raises for anything but a sentence."""
    known = read_fleet(folder)
    list(status_blocks(list(rows_on_disk(known, output))))
    write_index(known, output)
    of_type = members(known, output, KIND)
    population_loads(KIND, of_type.campaigns)
    said = [
        _sentence(lambda: assemble(of_type, known.shared, HyperPriors())),
        _sentence(lambda: result_digest(campaign_output(output, CHANGED) / RESULT_FILE)),
    ]
    assert all(sentence.endswith(".") for sentence in said)


def _sentence(action: Callable[[], object]) -> str:
    try:
        action()
    except SysidError as error:
        return str(error)
    return "."


def test_the_untouched_fleet_is_looked_at_whole(fleet: tuple[Path, Path]) -> None:
    pytest.importorskip("pyarrow")
    looked_at(*fleet)
    import pyarrow.parquet as pq

    table = pq.read_table(fleet[1] / "fleet.parquet" / "parameters.parquet")
    assert set(table["campaign"].to_pylist()) == {f"T{t}-{c}" for t in range(1, 5) for c in (1, 2)}


@pytest.mark.skipif(os.name == "nt", reason="pipes and sockets are not files on Windows")
@pytest.mark.parametrize("name", FILE_DAMAGES)
@pytest.mark.parametrize("file", [OUTCOME_FILE, RESULT_FILE, RECORD_FILE])
def test_a_damaged_file(file: str, name: str, fleet: tuple[Path, Path]) -> None:
    pytest.importorskip("pyarrow")
    path = campaign_output(fleet[1], CHANGED) / file
    FILE_DAMAGES[name][1](path, np.random.default_rng(5))
    looked_at(*fleet)


@pytest.mark.parametrize("file", first_then_long(RESULT_FILE, OUTCOME_FILE, RECORD_FILE))
def test_values_of_another_type(file: str, fleet: tuple[Path, Path]) -> None:
    pytest.importorskip("pyarrow")
    path = campaign_output(fleet[1], CHANGED) / file
    good, rng = path.read_bytes(), np.random.default_rng(6)
    for _ in range(60):
        path.write_bytes(good)
        if file == RECORD_FILE and rng.random() < 0.5:
            array_changed(path, rng)
        else:
            _one_changed(path, rng)
        looked_at(*fleet)


def _one_changed(path: Path, rng: np.random.Generator) -> None:
    stored = array_file.read(path) if path.name == RECORD_FILE else None
    document: Any = json.loads(path.read_bytes()) if stored is None else stored.fields
    places = list(_places({"document": document}))
    holder, key = places[int(rng.integers(len(places)))]
    holder[key] = _LEAVES[int(rng.integers(len(_LEAVES)))]
    if stored is None:
        path.write_text(json.dumps(document if key != "document" else holder[key]), encoding="utf-8")
    else:
        array_file.write(path, document, stored.arrays)
