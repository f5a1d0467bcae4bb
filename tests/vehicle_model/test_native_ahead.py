"""The engine compiled beside other work: once, waited for by who needs it, and given up with the work."""

from __future__ import annotations

import os
import stat
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest
import rigid_truck
import verification_case

from sysid.campaign.vehicle_records import AxleGroup, FrameBending
from sysid.vehicle_model import engine
from sysid.vehicle_model.assembly import assemble, body_coordinates
from sysid.vehicle_model.native import ahead, build

pytestmark = pytest.mark.skipif(os.name == "nt", reason="processes have no groups on Windows")

#: Long for a test, and short for a test run that hangs.
LONG_S = 60.0


@pytest.fixture
def compiler(unregistered, monkeypatch):
    """A program that takes some seconds for a few bytes, and has a child that does the work."""

    def put(seconds: float) -> Path:
        path = unregistered / "slow-c++"
        path.write_text(
            f'#!/bin/sh\n[ "$1" = --version ] && exit 0\necho assembler > "$(mktemp)"\n'
            f"sleep {seconds} &\necho $! >> {unregistered}/children\nwait\n"
            'while [ "$1" != -o ]; do shift; done\necho library > "$2"\n'
        )
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("CXX", str(path))
        return unregistered / "children"

    monkeypatch.setenv("SYSID_THREADS", "2")
    monkeypatch.setenv("TMPDIR", str(unregistered / "tmp"))
    (unregistered / "tmp").mkdir()
    return put


def ended(process: int) -> bool:
    """Whether a process has ended; what is left of it may wait for its parent."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    state = Path(f"/proc/{process}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z"


def libraries(folder: Path) -> list[str]:
    """Numbers of coordinates that there are libraries for, and whatever else stands beside them."""
    return sorted(p.name.rpartition("-")[2] for p in (folder / "cache" / "engine").glob("*"))


def test_who_needs_it_waits_and_nothing_is_compiled_twice(compiler, unregistered):
    children = compiler(0.5)
    with ahead.compiled_ahead([4, 5]):
        while not children.exists():
            time.sleep(0.02)
        assert build.library(4).read_bytes() == b"library\n"
        assert build.library(5).read_bytes() == b"library\n"
    assert len(children.read_text().split()) == 2
    assert libraries(unregistered) == ["4", "5"]


@pytest.mark.parametrize("failing", [True, False])
def test_what_is_not_compiled_when_the_work_ends_is_given_up(compiler, unregistered, failing):
    """At once, with the compiler's own processes, and without half a library left behind."""
    children, begin = compiler(LONG_S), time.monotonic()
    with pytest.raises(KeyboardInterrupt) if failing else nullcontext(), ahead.compiled_ahead([4, 5]):
        while not children.exists() or not children.read_text().strip():
            time.sleep(0.02)
        if failing:
            raise KeyboardInterrupt
    assert time.monotonic() - begin < LONG_S / 2
    (child,) = children.read_text().split()
    assert ended(int(child))
    assert libraries(unregistered) == []
    assert not any((unregistered / "tmp").iterdir())


def test_a_broken_compiler_says_nothing_here(monkeypatch, unregistered, capfd):
    monkeypatch.setenv("SYSID_THREADS", "2")
    monkeypatch.setenv("CXX", "false")
    with ahead.compiled_ahead([4]):
        time.sleep(0.2)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("threads", "name", "begun"), [("2", "auto", True), ("1", "auto", False), ("2", "jax", False)])
def test_one_thread_or_another_engine_compiles_nothing_ahead(compiler, monkeypatch, threads, name, begun):
    children = compiler(0.1)
    monkeypatch.setenv("SYSID_THREADS", threads)
    monkeypatch.setenv("SYSID_ENGINE", name)
    with engine.compiled_ahead(rigid_truck.VEHICLE, parts=False):
        end = time.monotonic() + (LONG_S if begun else 1.0)
        while not children.exists() and time.monotonic() < end:
            time.sleep(0.02)
    assert children.exists() == begun


@pytest.mark.parametrize("parts", [False, True])
def test_the_search_for_parts_needs_one_coordinate_more(monkeypatch, parts):
    asked: list[list[int]] = []
    monkeypatch.setattr(engine.ahead, "compiled_ahead", lambda numbers: asked.append(list(numbers)) or nullcontext())
    with engine.compiled_ahead(rigid_truck.VEHICLE, parts=parts):
        pass
    assert asked == [[3, 4] if parts else [3]]


def test_body_coordinates_are_the_columns_of_the_assembled_model():
    truck, group = rigid_truck.VEHICLE, AxleGroup("bogie", (1, 2), 300.0, 90.0)
    bent = replace(truck, bodies=tuple(replace(body, bending=FrameBending(8.0, 0.03)) for body in truck.bodies))
    sprung = (rigid_truck.EMPTY.sprung_mass_kg[0] - 300.0,)
    beam, carried = replace(truck, groups=(group,)), replace(rigid_truck.EMPTY, sprung_mass_kg=sprung)
    articulated, loads = verification_case.vehicle_and_loads(heights=True)
    for vehicle, case, number in (
        (truck, rigid_truck.EMPTY, 3),
        (bent, rigid_truck.EMPTY, 4),
        (beam, carried, 3),
        (articulated, next(iter(loads.values())), 4),
    ):
        assert body_coordinates(vehicle) == number
        assert assemble(vehicle, case).heave_rows.shape[1] == number
