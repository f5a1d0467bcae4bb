"""Readings of single drops that are kept: of the same drop nothing is computed twice, of another one everything is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_results import small_results

from sysid.sdof.drop_results import DropAnalysis
from sysid.sdof.settings import DropSettings
from sysid.workflow import drop_readings
from sysid.workflow.drop_readings import forget_readings, kept_readings
from sysid.workflow.store import digest_of

RESULTS = small_results()


def drops(count: int) -> list[Any]:
    """Drops whose files are named a, b, ..., all with the readings of the same one."""
    campaign = RESULTS.campaign
    drop = campaign.plank_drops[0]
    case = campaign.load_cases[drop.load_case]
    names = (chr(ord("a") + n) for n in range(count))
    return [(replace(drop, log=replace(drop.log, file=n)), campaign.vehicle, case, DropSettings()) for n in names]


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Files of the drops that are analysed; every analysis is another one."""
    seen: list[str] = []
    assert RESULTS.drops is not None
    one = RESULTS.drops.files[0]

    def analysed(of: Sequence[Any], done: Callable[[float], None]) -> tuple[DropAnalysis, ...]:
        seen.extend(drop.log.file for drop, *_ in of)
        return tuple(replace(one, file=f"{drop.log.file}{len(seen)}") for drop, *_ in of)

    monkeypatch.setattr(drop_readings, "analysed", analysed)
    return seen


def names(folder: Path, of: list[Any]) -> list[str]:
    return [a.file for a in kept_readings(folder)(of, lambda share: None)]


def test_only_what_is_new_is_read(tmp_path: Path, read: list[str]) -> None:
    (tmp_path / "stages").mkdir()
    first = names(tmp_path, drops(2))
    assert read == ["a", "b"]
    assert names(tmp_path, drops(3))[:2] == first
    assert read == ["a", "b", "c"]
    assert names(tmp_path, drops(3)[::-1])[1:] == first[::-1]
    assert read == ["a", "b", "c"]
    forget_readings(tmp_path)
    names(tmp_path, drops(1))
    assert read == ["a", "b", "c", "a"]


def test_other_readings_vehicle_or_settings_are_read_anew(tmp_path: Path, read: list[str]) -> None:
    (tmp_path / "stages").mkdir()
    (of,) = drops(1)
    names(tmp_path, [of])
    drop, vehicle, case, settings = of
    channel = drop.log.channels[0]
    value = channel.value.copy()
    value[3] = np.nextafter(value[3], 1.0)
    moved = replace(drop.log, channels=(replace(channel, value=value), *drop.log.channels[1:]))
    others = [
        (replace(drop, log=moved), vehicle, case, settings),
        (drop, replace(vehicle, name="another"), case, settings),
        (drop, vehicle, replace(case, cargo_mass_kg=17.0), settings),
        (drop, vehicle, case, replace(settings, tire_stiffness_tolerance=0.06)),
    ]
    for count, other in enumerate(others, start=2):
        names(tmp_path, [other])
        assert len(read) == count


def test_other_code_reads_anew(tmp_path: Path, read: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "stages").mkdir()
    names(tmp_path, drops(1))
    monkeypatch.setattr(drop_readings, "code_digest", lambda packages: "edited")
    names(tmp_path, drops(1))
    assert read == ["a", "a"]


def test_a_digest_tells_apart_what_only_shapes_and_types_tell() -> None:
    some = np.zeros(4)
    alike = [some, some.reshape(2, 2), some.astype(np.int64), some[:2], some + 1.0]
    assert len({digest_of(a) for a in alike}) == 5
    assert digest_of(np.zeros((2, 2)).T) == digest_of(np.zeros((2, 2)))
