"""A campaign is written again while somebody reads: every reader sees one whole result, or that there is none."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.errors import SysidError
from sysid.fleet import assembly, index
from sysid.fleet.assembly import assemble
from sysid.fleet.draws import RECORD_FILE, read_draws, record_digest, write_draws
from sysid.fleet.hierarchy import HyperPriors
from sysid.fleet.key import file_digests, result_digest
from sysid.fleet.members import members
from sysid.fleet.outcome import RESULT_FILE, read_outcome, write_outcome
from sysid.fleet.read import read_fleet
from sysid.fleet.running import campaign_output
from sysid.fleet.status import rows_on_disk

CAMPAIGN, KIND, FACTOR = "T2-1", "short truck", 2.0
Step = Callable[[], object]


def steps_to_another_result(place: Path) -> list[Step]:
    """What the process of a campaign writes, in its order: results, draws for the fleet, and last the outcome."""
    document = json.loads((place / RESULT_FILE).read_text(encoding="utf-8"))
    for parameter in document["parameters"]:
        parameter["least_squares"]["value"] *= FACTOR
    record = read_draws(place / RECORD_FILE)
    moved = replace(record, draws=record.draws + np.log(FACTOR), prior_mean=record.prior_mean + np.log(FACTOR))
    return [
        lambda: (place / RESULT_FILE).write_text(json.dumps(document), encoding="utf-8"),
        lambda: write_draws(place / RECORD_FILE, moved),
        lambda: sealed(place),
    ]


def sealed(place: Path) -> None:
    """The outcome says which result and which draws are its own, as :mod:`sysid.fleet.child` writes it."""
    (digest,) = file_digests(place, [RESULT_FILE]).values()
    own = {
        "result_sha256": result_digest(place / RESULT_FILE),
        "file_sha256": digest,
        "draws_sha256": record_digest(place),
    }
    write_outcome(place, replace(read_outcome(place), **own))


@pytest.fixture
def fleet(fleet_folders: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path, list[Step]]:
    """Folder of the fleet file, that of the results, and the steps to another result of one campaign."""
    folder, output = fleet_folders[0], tmp_path / "out"
    shutil.copytree(fleet_folders[1], output)
    for place in (output / "campaigns").iterdir():
        sealed(place)
    return folder, output, steps_to_another_result(campaign_output(output, CAMPAIGN))


def in_tables(folder: Path, output: Path) -> tuple[float | None, float | None]:
    """Value of the first parameter, and median of its draws, in the tables; None where they have none."""
    pq = pytest.importorskip("pyarrow.parquet")
    tables = index.write_index(read_fleet(folder), output)
    values = pq.read_table(tables / "parameters.parquet").to_pandas().set_index("campaign")["value"]
    draws = pq.read_table(tables / "draws.parquet").to_pandas().set_index("campaign")
    draws = draws[draws["name"] == "k_1"]["values"]
    value = float(values.loc[[CAMPAIGN]].iloc[0]) if CAMPAIGN in values.index else None
    return value, float(np.median(draws.loc[CAMPAIGN])) if CAMPAIGN in draws.index else None


def as_member(folder: Path, output: Path) -> float | None:
    """Centre of the likelihood of the first parameter, as a population counts it; None where it is left out."""
    found = assemble(members(read_fleet(folder), output, KIND), (), HyperPriors())
    if CAMPAIGN not in found.data.campaigns:
        return None
    at = found.data.campaigns.index(CAMPAIGN)
    return float(np.exp(np.linalg.solve(found.data.precision[at], found.data.shift[at])[0]))


def same(found: float | None, expected: float | None) -> bool:
    return found is None if expected is None else found is not None and abs(found / expected - 1.0) < 1e-6


@pytest.mark.parametrize("written", [0, 1, 2, 3])
def test_between_any_two_files_a_reader_sees_one_result_or_none(
    fleet: tuple[Path, Path, list[Step]], written: int
) -> None:
    folder, output, steps = fleet
    value, draws = in_tables(folder, output)
    member = as_member(folder, output)
    for step in steps[:written]:
        step()
    factor = {0: 1.0, 3: FACTOR}.get(written)
    found = (*in_tables(folder, output), as_member(folder, output))
    expected = [None if factor is None else factor * x for x in (value, draws, member)]
    assert all(same(f, e) for f, e in zip(found, expected, strict=True)), (found, expected)
    states = {row.campaign: row.state for row in rows_on_disk(read_fleet(folder), output)}
    assert states[CAMPAIGN] == ("changed" if factor is None else "done")


@pytest.mark.parametrize("written", [1, 2, 3])
def test_within_a_reader_too(
    fleet: tuple[Path, Path, list[Step]], written: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The files change after the reader has looked at their hashes, and before it reads what is in them."""
    folder, output, steps = fleet
    good = (*in_tables(folder, output), as_member(folder, output))

    def writing_first(function: Callable[..., object], is_it: Callable[..., bool]) -> Callable[..., object]:
        def call(*arguments: object) -> object:
            if is_it(*arguments):
                for step in steps[:written]:
                    step()
            return function(*arguments)

        return call

    rows_of = writing_first(index.campaign_rows, lambda row, *_: row.campaign == CAMPAIGN)
    monkeypatch.setattr(index, "campaign_rows", rows_of)
    value, draws = in_tables(folder, output)
    assert (value, draws) == (None, None)
    # As before, for the population.
    for step in steps_back(output, fleet):
        step()
    draws_of = writing_first(assembly.campaign_draws, lambda place, *_: place.name == CAMPAIGN)
    monkeypatch.setattr(assembly, "campaign_draws", draws_of)
    assert same(as_member(folder, output), good[2] if written == 1 else None)


def steps_back(output: Path, fleet: tuple[Path, Path, list[Step]]) -> list[Step]:
    """To the first result again."""
    place = campaign_output(output, CAMPAIGN)
    document = json.loads((place / RESULT_FILE).read_text(encoding="utf-8"))
    for parameter in document["parameters"]:
        parameter["least_squares"]["value"] /= FACTOR
    record = read_draws(place / RECORD_FILE)
    moved = record.draws[0, 0] > np.log(4e5) + 0.5
    shift = np.log(FACTOR) if moved else 0.0
    back = replace(record, draws=record.draws - shift, prior_mean=record.prior_mean - shift)
    return [
        lambda: (place / RESULT_FILE).write_text(json.dumps(document), encoding="utf-8"),
        lambda: write_draws(place / RECORD_FILE, back),
        lambda: sealed(place),
    ]


def test_the_tables_are_the_old_ones_until_they_are_whole(
    fleet: tuple[Path, Path, list[Step]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """`index` that ends early leaves what was there."""
    pq = pytest.importorskip("pyarrow.parquet")
    folder, output, _ = fleet
    tables = index.write_index(read_fleet(folder), output)
    before = {p.name: p.read_bytes() for p in tables.iterdir()}

    def full(*_: object) -> object:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(index, "campaign_rows", full)
    with pytest.raises(SysidError, match="No space left"):
        index.write_index(read_fleet(folder), output)
    assert {p.name: p.read_bytes() for p in tables.iterdir()} == before
    assert [p for p in output.iterdir() if p.name.startswith(".writing-")] == []
    assert pq.read_table(tables / "campaigns.parquet").num_rows == 12


def test_tables_of_two_writings_can_be_told(
    fleet: tuple[Path, Path, list[Step]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are replaced one by one: whoever reads in between finds that they do not belong together."""
    pq = pytest.importorskip("pyarrow.parquet")
    folder, output, steps = fleet
    tables = index.write_index(read_fleet(folder), output)

    def written() -> list[bytes]:
        return [pq.read_schema(p).metadata[b"sysid_fleet_written"] for p in sorted(tables.glob("*.parquet"))]

    before, between, replace_file = written(), [], os.replace

    def watched(source: Path, target: Path, **where: int | None) -> None:
        replace_file(source, target, **where)
        if Path(target).suffix == ".parquet":
            between.append(written())

    for step in steps:
        step()
    monkeypatch.setattr(index.os, "replace", watched)
    index.write_index(read_fleet(folder), output)
    assert len(set(before)) == len(set(written())) == 1
    assert set(before).isdisjoint(written())
    assert [len(set(seen)) for seen in between] == [2] * (len(before) - 1) + [1]
