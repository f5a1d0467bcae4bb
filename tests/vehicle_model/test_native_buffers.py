"""The arrays that cross into the compiled engine: one description, and what a wrong array is told."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
import rigid_truck
from native_engine import needs_compiler
from test_native_engine import truck

from sysid.vehicle_model.engines import native
from sysid.vehicle_model.filters import discretise
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.native import buffers, build, header, kernel
from sysid.vehicle_model.native.kernel import Call
from sysid.vehicle_model.simulation import Histories


@pytest.fixture(scope="module")
def call() -> Call:
    """Two runs of a truck with three axles on one body, 50 samples, 2 sets."""
    case = truck(footprint=True, samples=50, sets=2)
    road = native.NATIVE.prepare(case.road, case.axle_x, Motion(jnp.ones((2, 1)), jnp.zeros((2, 1))), case.timing)
    step_s = case.timing.interval_s / case.timing.substeps
    laws = case.suspension, case.tire
    return native._call(
        "sensors", case.stacked, laws, road, case.timing, case.layout, discretise(rigid_truck.FILTER, step_s)
    )


def test_every_array_has_a_name_of_its_own():
    for entry in buffers.ENTRIES.values():
        names = [b.name for b in entry.buffers]
        assert len(names) == len(set(names))
    assert tuple(b.name for b in buffers.ENTRIES["histories"].results) == Histories._fields


@pytest.mark.parametrize(
    ("dimension", "number"), [("na", 3), ("2 na", 6), ("2 na + nb", 10), (5, 5), ("nb + 3 na + na", 16)]
)
def test_sizes_of_symbols(dimension, number):
    assert buffers.size(dimension, {"na": 3, "nb": 4}) == number


def test_a_sound_call_crosses_in_the_described_order(call):
    ordered = call.ordered()
    assert [a is call.arrays[b.name] for a, b in zip(ordered, buffers.BLOCKS["common"], strict=True)] == [True] * 27


@pytest.mark.parametrize("name", [b.name for b in buffers.BLOCKS["common"]])
def test_every_array_of_a_wrong_shape_is_named(call, name):
    """One more along the last axis: the message has the array, its shape and the expected one."""
    array = np.asarray(call.arrays[name])
    shape = (*array.shape[:-1], array.shape[-1] + 1) if array.size else (2, 2)
    wrong = call._replace(arrays={**call.arrays, name: np.zeros(shape)})
    with pytest.raises(ValueError, match=rf"The array `{name}` .* has the shape \({shape[0]}") as caught:
        wrong.ordered()
    expected = next(b for b in buffers.BLOCKS["common"] if b.name == name).shape
    assert f"it should be ({', '.join(map(str, expected))})" in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize("kind", [np.float32, np.int64, bool])
def test_an_array_of_another_type_is_named(call, kind):
    wrong = call._replace(arrays={**call.arrays, "rise": np.asarray(call.arrays["rise"]).astype(kind)})
    with pytest.raises(ValueError, match=r"The array `rise` .* holds .*; it should hold float64"):
        wrong.ordered()


def test_missing_and_unknown_arrays_are_named(call):
    fewer = {name: array for name, array in call.arrays.items() if name != "drag"}
    with pytest.raises(ValueError, match="`sensors` of the native engine lacks the array `drag`"):
        call._replace(arrays=fewer).ordered()
    with pytest.raises(ValueError, match="does not know the array `camber`"):
        call._replace(arrays={**call.arrays, "camber": np.zeros(3)}).ordered()


def test_the_header_follows_the_description(monkeypatch):
    """A change of any array, constant or element changes the fingerprint, by which a library is known."""
    before, text = header.fingerprint(), header.header()
    assert text.index("kPosition,") < text.index("kLaws,") < text.index("kCommonCount")
    common = buffers.BLOCKS["common"]
    found = {before}
    for changed in (
        (common[1], common[0], *common[2:]),
        common[:-1],
        (common[0]._replace(shape=("R", "nb")), *common[1:]),
    ):
        monkeypatch.setitem(buffers.BLOCKS, "common", changed)
        found.add(header.fingerprint())
    monkeypatch.setitem(buffers.BLOCKS, "common", common)
    monkeypatch.setitem(buffers.CONSTANTS, "kMaxAxles", 25)
    found.add(header.fingerprint())
    monkeypatch.undo()
    monkeypatch.setitem(buffers.ELEMENT_FIELDS, "hook", ("hook_stiffness",))
    found.add(header.fingerprint())
    monkeypatch.undo()
    monkeypatch.setitem(buffers.SETTINGS, "samples", float)
    found.add(header.fingerprint())
    assert len(found) == 7


@needs_compiler
def test_the_library_counts_its_arrays(call, monkeypatch):
    """Were the check in Python passed by, the compiled side would still refuse."""
    kernel.prepare()
    monkeypatch.setattr(Call, "ordered", lambda self: list(self.arrays.values())[:-1])
    with pytest.raises(ValueError, match="another number of arrays"):
        kernel.run(call)


def test_memory_that_does_not_suffice_is_told_from_a_wrong_call(call):
    """What the compiled side says becomes the error that Python has for it."""

    class Library:
        def __init__(self, words: str):
            self.sysid_sensors = lambda *given: words.encode("ascii")

    shapes = [(50, 2, 7, 2)]
    with pytest.raises(MemoryError, match="memory does not suffice"):
        kernel._computed(Library(buffers.NO_MEMORY), call, call.ordered(), shapes)
    with pytest.raises(ValueError, match="some other words"):
        kernel._computed(Library("some other words"), call, call.ordered(), shapes)


@needs_compiler
def test_memory_that_does_not_suffice_ends_the_call_alone(call):
    """A record of 2^50 samples: no thread ends the process."""
    kernel.prepare()
    longer = {**call.settings, "samples": 2**50}
    readings = {name: np.zeros((0, 2, 7)) for name in ("value", "measured", "censored")}
    readings |= {"noise_sd": np.ones((2, 7)), "tempering": np.ones((2, 7)), "gain_sd": np.ones(7)}
    columns = {"columns_residual": np.zeros((2, 3, 7, 0)), "columns_gain": np.zeros((2, 7, 3))}
    arrays = {**call.arrays, **readings, **columns}
    misfits = Call("misfits", arrays, {**call.sizes, "T": 0, "K": 3}, longer)
    with pytest.raises(MemoryError, match="memory does not suffice"):
        kernel.run(misfits)
    assert np.isfinite(kernel.run(call)[0]).all()


@needs_compiler
def test_a_library_refuses_vehicles_that_it_is_not_compiled_for(call, tmp_path, monkeypatch):
    compiler = build.find_compiler()
    assert compiler is not None
    # Without optimisation: nothing is computed.
    build.compile_engine(compiler, tmp_path / "engine.so", "-O0", "-DSYSID_COORDINATES=8")
    other = kernel.load(tmp_path / "engine.so", "eight coordinates")
    monkeypatch.setattr(kernel, "_loaded", lambda coordinates: other)
    with pytest.raises(ValueError, match="not compiled for so many body coordinates"):
        kernel.run(call)


def test_sizes_of_a_call(call):
    assert call.sizes["C"] == 3 + 2 + 2
    assert call.sizes | {"nb": 3, "nr": 2, "na": 3, "R": 2, "S": 2, "T": 50, "J": 0, "L": 6} == dict(call.sizes)
