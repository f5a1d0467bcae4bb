"""What a file says of its axis and of its values is followed or refused: files made by the writers of the formats."""

from __future__ import annotations

import io
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sysid.errors import DataRejectedError
from sysid.logs.channels import LogContent, LogRequest
from sysid.logs.input_file import InputFile
from sysid.logs.registry import read_channels

ROWS = 400
TIME_S = 0.005 * np.arange(ROWS)
VALUES = np.round(np.sin(9.0 * TIME_S), 3)
START = np.datetime64("2024-05-01T10:00:00.000", "ms")


def content(name: str, data: bytes, *wanted: str, **request) -> LogContent:
    return read_channels(InputFile(Path(name), data), name, LogRequest(wanted, **request))


def stamps(name: str, data: bytes, wanted: str = "q_mm") -> np.ndarray:
    (channel,) = content(name, data, wanted).channels
    return channel.clock.time_s


def refusal(name: str, data: bytes, wanted: str = "q_mm") -> str:
    with pytest.raises(DataRejectedError) as error:
        content(name, data, wanted)
    return str(error.value)


# ---------------------------------------------------------------------- writers


def tdms(**channels: Mapping[str, Any]) -> bytes:
    """TDMS with one group: properties by name of channel; `data` among them are the values."""
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        writer.write_segment(
            [
                ChannelObject("G", name, one.get("data", VALUES), {k: v for k, v in one.items() if k != "data"})
                for name, one in channels.items()
            ]
        )
    return stream.getvalue()


def hdf5(**sets: Any) -> bytes:
    """HDF5 of arrays by name, or of pairs (array, attributes)."""
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for name, one in sets.items():
            data, attributes = one if isinstance(one, tuple) else (one, {})
            file[name] = data
            file[name].attrs.update(attributes)
    return stream.getvalue()


def uff(*sets: Mapping[str, Any], binary: int = 0) -> bytes:
    """Universal file of data sets 58 over time in seconds, but for what is given."""
    import pyuff

    plain = {
        "binary": binary, "func_type": 1, "rsp_node": 1, "rsp_dir": 3, "ref_dir": 1, "ref_node": 1, "data": VALUES,
        "x": TIME_S, "id1": "q_mm", "rsp_ent_name": "NONE", "ref_ent_name": "NONE", "abscissa_spacing": 1,
        "abscissa_spec_data_type": 17, "ordinate_spec_data_type": 8, "orddenom_spec_data_type": 0,
        "z_axis_spec_data_type": 0, "ordinate_axis_units_lab": "mm", "abscissa_axis_units_lab": "s",
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        path = str(Path(folder, "log.uff"))
        for one in sets:
            pyuff.UFF(path).write_sets(pyuff.prepare_58(**{**plain, **one}), mode="add")
        return Path(path).read_bytes()


def lvm(x_columns: str = "No", name: str = "q_mm", rows: tuple[str, ...] | None = None, **header: str) -> bytes:
    """LVM of one channel; cells of the header by key."""
    cells = {"X_Dimension": "Time", "X0": "0", "Delta_X": "0.005", **header}
    head = [
        "LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t.", f"X_Columns\t{x_columns}",
        "***End_of_Header***", "", "Channels\t1\t", f"Samples\t{ROWS}\t", "Y_Unit_Label\tmm\t",
        *(f"{key}\t{cell}\t" for key, cell in cells.items()), "***End_of_Header***\t\t", f"X_Value\t{name}\tComment",
    ]  # fmt: skip
    x = ["" if x_columns == "No" else f"{t:.6f}" for t in TIME_S]
    rows = rows or tuple(f"{v:.3f}" for v in VALUES)
    return "\r\n".join([*head, *(f"{a}\t{b}" for a, b in zip(x, rows, strict=True)), ""]).encode("cp1252")


# ---------------------------------------------------------------------- axes

#: File, its name, and stamps in seconds where they are not those of TIME_S.
WAVE = {"wf_increment": 5.0}
IN_OTHER_UNITS = {
    "TDMS ms": ("log.tdms", tdms(q_mm={**WAVE, "wf_xname": "Time", "wf_xunit_string": "ms"}), 0.0),
    "TDMS ms, offset": ("log.tdms", tdms(q_mm={**WAVE, "wf_start_offset": 250.0, "wf_xunit_string": "ms"}), 0.25),
    "TDMS time channel ms": (
        "log.tdms", tdms(time={"data": 1e3 * TIME_S, "unit_string": "ms"}, q_mm={"unit_string": "mm"}), 0.0
    ),
    "TDMS min": ("log.tdms", tdms(q_mm={"wf_increment": 0.005 / 60.0, "wf_xunit_string": "min"}), 0.0),
    "HDF5 ms": ("log.h5", hdf5(q_mm=(VALUES, {**WAVE, "wf_xunit_string": "ms", "wf_start_offset": 100.0})), 0.1),
    "TDMS in German": ("log.tdms", tdms(q_mm={**WAVE, "wf_xname": "Zeit", "wf_xunit_string": "Millisekunden"}), 0.0),
    "TDMS sample time": ("log.tdms", tdms(q_mm={**WAVE, "wf_xname": "Sample time", "wf_xunit_string": "msec."}), 0.0),
    "HDF5 integers in ms": ("log.h5", hdf5(q_mm=VALUES, time=(5 * np.arange(ROWS), {"units": "ms"})), 0.0),
    "UFF ms": ("log.uff", uff({"x": 1e3 * TIME_S, "abscissa_axis_units_lab": "ms"}), 0.0),
    "UFF of unsaid kind": ("log.uff", uff({"x": 1e3 * TIME_S, "abscissa_spec_data_type": 0,
                                           "abscissa_axis_units_lab": "ms"}), 0.0),
    "UFF that begins later": ("log.uff", uff({"x": TIME_S + 0.1}), 0.1),
    "LVM ms": ("log.lvm", lvm(Delta_X="5", X0="100", X_Unit_Label="ms"), 0.1),
    "LVM X column": ("log.lvm", lvm("One"), 0.0),
    "HDF5 start": ("log.h5", hdf5(q_mm=(VALUES, {"dt": 0.005, "t0": 0.1})), 0.1),
    "HDF5 rate and start": ("log.h5", hdf5(q_mm=(VALUES, {"sample_rate": 200.0, "start_time": -0.1})), -0.1),
}  # fmt: skip


@pytest.mark.parametrize(("name", "data", "start_s"), IN_OTHER_UNITS.values(), ids=IN_OTHER_UNITS)
def test_an_axis_of_time_is_converted_and_begins_where_the_file_says(name: str, data: bytes, start_s: float) -> None:
    np.testing.assert_allclose(stamps(name, data), start_s + TIME_S, rtol=0.0, atol=1e-9)


NO_TIME = {
    "TDMS distance": ("log.tdms", tdms(q_mm={**WAVE, "wf_xname": "Distance", "wf_xunit_string": "m"}), "Distance [m]"),
    "TDMS angle without unit": ("log.tdms", tdms(q_mm={**WAVE, "wf_xname": "Angle"}), "Angle"),
    "TDMS unit alone": ("log.tdms", tdms(q_mm={**WAVE, "wf_xunit_string": "deg"}), "a quantity [deg]"),
    "TDMS frequency in s": (
        "log.tdms", tdms(q_mm={**WAVE, "wf_xname": "Frequency", "wf_xunit_string": "s"}), "Frequency [s]"
    ),
    "TDMS time channel": (
        "log.tdms", tdms(time={"data": TIME_S, "unit_string": "m"}, q_mm={"unit_string": "mm"}), "'time' [m]"
    ),
    "HDF5": ("log.h5", hdf5(q_mm=(VALUES, {**WAVE, "wf_xname": "Position", "wf_xunit_string": "mm"})), "Position [mm]"),
    "UFF frequency": ("log.uff", uff({"abscissa_spec_data_type": 18, "abscissa_axis_units_lab": "Hz"}),
                      "frequency [Hz]"),
    "UFF of unsaid kind": ("log.uff", uff({"abscissa_spec_data_type": 1, "abscissa_axis_units_lab": "rev"}),
                           "a quantity [rev]"),
    "LVM": ("log.lvm", lvm(X_Dimension="Frequency", X_Unit_Label="Hz"), "Frequency [Hz]"),
    "LVM X column": ("log.lvm", lvm("One", X_Dimension="Length"), "Length"),
}  # fmt: skip


@pytest.mark.parametrize(("name", "data", "axis"), NO_TIME.values(), ids=NO_TIME)
def test_an_axis_that_is_not_time_is_refused(name: str, data: bytes, axis: str) -> None:
    assert f"its axis is {axis}, not time; export it over time in seconds." in refusal(name, data)


def test_waveforms_begin_when_they_say() -> None:
    later = {"wf_start_time": START + np.timedelta64(250, "ms"), "wf_increment": 0.005}
    first = {"wf_start_time": START, "wf_increment": 0.005}
    data = tdms(q_mm=first, a_g=later)
    assert stamps("log.tdms", data, "a_g") == pytest.approx(0.25 + TIME_S, abs=1e-9)
    assert stamps("log.tdms", data) == pytest.approx(TIME_S, abs=1e-9)
    unsaid = tdms(q_mm=first, a_g=later, b_g={"wf_increment": 0.005})
    assert "no wf_start_time for 'G/b_g'" in refusal("log.tdms", unsaid, "b_g")


@pytest.mark.parametrize(("pause_ms", "second_s"), [(0, 0.5), (250, 0.75)], ids=["goes on", "begun again"])
def test_a_waveform_in_several_pieces(pause_ms: int, second_s: float) -> None:
    """LabVIEW appends to a file: the start of the second piece stands in its own segment."""
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        for start in (START, START + np.timedelta64(500 + pause_ms, "ms")):
            about = {"wf_start_time": start, "wf_increment": 0.005}
            writer.write_segment([ChannelObject("G", "q_mm", VALUES[:100], about)])
    expected = np.concatenate([TIME_S[:100], second_s + TIME_S[:100]])
    np.testing.assert_allclose(stamps("log.tdms", stream.getvalue()), expected, rtol=0.0, atol=1e-9)


def test_data_sets_of_hdf5_begin_when_they_say() -> None:
    said = ("2024-05-01T12:00:00.250+02:00", "2024-05-01 10:00:00")
    data = hdf5(**{name: (VALUES, {"dt": 0.005, "start_time": text}) for name, text in zip("ab", said, strict=True)})
    assert stamps("log.h5", data, "a") == pytest.approx(0.25 + TIME_S, abs=1e-9)
    assert stamps("log.h5", data, "b") == pytest.approx(TIME_S, abs=1e-9)
    strange = hdf5(q_mm=(VALUES, {"dt": 0.005, "pretrigger": 0.5}))
    assert "the attribute 'pretrigger' beside the step of 'q_mm'" in refusal("log.h5", strange)
    assert "a start of 'q_mm' that cannot be read" in refusal(
        "log.h5", hdf5(q_mm=(VALUES, {"dt": 0.005, "start_time": "yesterday"}))
    )


def test_what_a_group_of_hdf5_says_holds_for_its_data_sets() -> None:
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file.attrs.update({"sample_rate": 200.0, "start_time": "2024-05-01T10:00:00"})
        file["front/q_mm"], file["rear/a_g"], file["timed/b_g"] = VALUES, VALUES, VALUES
        file["rear"].attrs["start_offset_s"] = 0.1
        file["timed/time"] = 2.0 * TIME_S
    data = stream.getvalue()
    assert stamps("log.h5", data, "q_mm") == pytest.approx(TIME_S, abs=1e-9)
    assert stamps("log.h5", data, "a_g") == pytest.approx(0.1 + TIME_S, abs=1e-9)
    assert stamps("log.h5", data, "b_g") == pytest.approx(2.0 * TIME_S, abs=1e-9)


def test_the_dimension_of_a_netcdf_variable_is_its_axis(tmp_path: Path) -> None:
    """Two rates and a profile over distance in one group, as xarray writes them."""
    import xarray as xr

    first = np.datetime64("2024-05-01T10:00:00", "ns")
    fast = first + np.timedelta64(100, "ms") + (2_500_000 * np.arange(ROWS)).astype("m8[ns]")
    variables = {
        "q_mm": ("slow", VALUES, {"units": "mm"}),
        "a_g": ("fast", VALUES, {"units": "g"}),
        "road": ("station", VALUES, {"units": "mm"}),
        "bare": ("row", VALUES),
    }
    axes = {
        "slow": first + (5_000_000 * np.arange(ROWS)).astype("m8[ns]"),
        "fast": fast,
        "station": ("station", 0.05 * np.arange(ROWS), {"units": "m"}),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        xr.Dataset(variables, axes).to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    data = (tmp_path / "log.nc").read_bytes()
    q, a = content("log.nc", data, "q_mm", "a_g").channels
    assert q.clock.time_s - q.clock.time_s[0] == pytest.approx(TIME_S, abs=1e-9)
    assert a.clock.time_s - q.clock.time_s[0] == pytest.approx(0.1 + 0.5 * TIME_S, abs=1e-9)
    assert "its axis is station [m], not time" in refusal("log.nc", data, "road").replace("a quantity", "station")
    assert "no time column for 'bare'" in refusal("log.nc", data, "bare")
    everything = content("log.nc", data, everything=True)
    assert {c.name for c in everything.channels} == {"q_mm", "a_g"}


# ---------------------------------------------------------------------- values


def test_packed_values_and_fill_values_of_hdf5() -> None:
    """Oracle by hand: 7 * 0.05 + 2 = 2.35."""
    packed = np.full(ROWS, 7, "<i2")
    packed[3:6] = -9999
    packed[9] = 300
    attributes = {"scale_factor": 0.05, "add_offset": 2.0, "_FillValue": np.int16(-9999), "valid_max": np.int16(200)}
    found = content("log.h5", hdf5(q_mm=(packed, attributes), time=TIME_S), "q_mm")
    (channel,) = found.channels
    assert np.flatnonzero(np.isnan(channel.values)).tolist() == [3, 4, 5, 9]
    assert channel.values[0] == pytest.approx(2.35, abs=1e-12)
    assert found.messages == (
        "log.h5: 4 of 400 samples of 'q_mm' are marked as invalid or hold no number; they are missing.",
    )


@pytest.mark.parametrize(
    ("attributes", "numbers", "expected"),
    [
        ({"missing_value": [-1.0, -2.0]}, [-1.0, 5.0, -2.0], [np.nan, 5.0, np.nan]),
        ({"valid_range": [0.0, 6.0]}, [-1.0, 5.0, 7.0], [np.nan, 5.0, np.nan]),
        ({"_Unsigned": "true"}, np.array([-1, 5, 7], "<i2"), [65535.0, 5.0, 7.0]),
        ({"add_offset": 1.0}, np.array([-1, 5, 7], ">i2"), [0.0, 6.0, 8.0]),
        ({}, [9.969209968386869e36, 5.0, 7.0], [np.nan, 5.0, 7.0]),
    ],
)
def test_conventions_of_netcdf(attributes, numbers, expected) -> None:
    data = hdf5(q_mm=(numbers, attributes), time=TIME_S[:3])
    np.testing.assert_array_equal(content("log.h5", data, "q_mm").channels[0].values, expected)


def test_a_scale_of_no_convention_is_said_and_not_applied() -> None:
    (said,) = content(
        "log.h5",
        hdf5(
            q_mm=(VALUES, {"dt": 0.005, "gain": 20.0}),
        ),
        "q_mm",
    ).messages
    assert "the attribute 'gain' = 20 of 'q_mm' is not applied" in said
    assert content("log.h5", hdf5(q_mm=(VALUES, {"dt": 0.005, "gain": 1.0, "full_scale": 9.0})), "q_mm").messages == ()


HOLES = VALUES.copy()
HOLES[10:15] = np.nan
WITH_HOLES = {
    "TDMS": ("log.tdms", tdms(q_mm={"data": HOLES, "wf_increment": 0.005}), "G/"),
    "HDF5": ("log.h5", hdf5(q_mm=(HOLES, {"dt": 0.005})), ""),
    # The writer of universal files turns holes into zeros.
    "UFF": (
        "log.uff",
        uff({"data": np.where(np.isnan(HOLES), 77.0, HOLES)}, binary=1).replace(
            np.float64(77.0).tobytes(), np.float64(np.nan).tobytes()
        ),
        "1+Z/",
    ),
    "LVM": ("log.lvm", lvm("One", rows=tuple("" if np.isnan(v) else f"{v:.3f}" for v in HOLES)), ""),
}


@pytest.mark.parametrize(("name", "data", "group"), WITH_HOLES.values(), ids=WITH_HOLES)
def test_missing_samples_stay_on_their_clock_and_are_counted(name: str, data: bytes, group: str) -> None:
    found = content(name, data, "q_mm")
    (channel,) = found.channels
    np.testing.assert_array_equal(np.isnan(channel.values), np.isnan(HOLES))
    np.testing.assert_allclose(channel.clock.time_s, TIME_S, rtol=0.0, atol=1e-6)
    assert [m for m in found.messages if f"5 of 400 samples of '{group}q_mm'" in m]


def test_missing_samples_of_mat_and_parquet_are_counted() -> None:
    import pyarrow as pa
    from pyarrow.parquet import write_table
    from scipy.io import savemat

    mat, parquet = io.BytesIO(), io.BytesIO()
    savemat(mat, {"time_s": TIME_S, "q_mm": HOLES})
    cells = [None if np.isnan(v) else v for v in HOLES]
    write_table(pa.table({"time_s": TIME_S, "q_mm": pa.array(cells, pa.float64())}), parquet)
    for name, stream in (("log.mat", mat), ("log.parquet", parquet)):
        found = content(name, stream.getvalue(), "q_mm")
        assert "5 of 400 samples" in found.messages[0]
        np.testing.assert_array_equal(np.isnan(found.channels[0].values), np.isnan(HOLES))


# ---------------------------------------------------------------------- names and places


def test_functions_of_one_name_are_told_apart_by_node_and_direction() -> None:
    data = uff({"rsp_node": 12}, {"rsp_node": 14, "data": 2.0 * VALUES, "x": TIME_S + 0.1})
    assert "name the column '12+Z/q_mm' or '14+Z/q_mm'" in refusal("log.uff", data)
    (second,) = content("log.uff", data, "14+Z/q_mm").channels
    assert second.values == pytest.approx(2.0 * VALUES, abs=1e-9)
    assert second.clock.time_s == pytest.approx(TIME_S + 0.1, abs=1e-9)
    same = uff({}, {"data": 2.0 * VALUES})
    assert content("log.uff", same, "1+Z/q_mm #2").channels[0].values == pytest.approx(2.0 * VALUES, abs=1e-9)


def test_columns_of_one_name_in_parquet_are_told_apart() -> None:
    import pyarrow as pa
    from pyarrow.parquet import write_table

    stream = io.BytesIO()
    write_table(pa.table([TIME_S, VALUES, 2.0 * VALUES], names=["time_s", "q_mm", "q_mm"]), stream)
    assert "name the column 'q_mm #1' or 'q_mm #2'" in refusal("log.parquet", stream.getvalue())
    (second,) = content("log.parquet", stream.getvalue(), "q_mm #2").channels
    np.testing.assert_array_equal(second.values, 2.0 * VALUES)


def test_structures_of_matlab_have_places_of_their_own() -> None:
    from scipy.io import savemat

    stream = io.BytesIO()
    signals = np.array([({"v": VALUES},), ({"v": 2.0 * VALUES},)], [("inner", object)])
    savemat(
        stream,
        {
            "A": {"t": TIME_S, "q": VALUES},
            "B": {"t": TIME_S + 0.1, "q": 2.0 * VALUES, "part": {"p": 3.0 * VALUES}},
            "S": {"time": TIME_S, "signals": signals},
            "words": np.array(["a", "b"], object),
            "table": np.zeros((4, 3)),
        },
    )
    data = stream.getvalue()
    assert "name the column 'A/q' or 'B/q'" in refusal("log.mat", data, "q")
    for name, times, factor in (("B/q", TIME_S + 0.1, 2.0), ("B/part/p", TIME_S + 0.1, 3.0),
                                ("S/signals(2)/inner/v", TIME_S, 2.0)):  # fmt: skip
        (found,) = content("log.mat", data, name).channels
        np.testing.assert_array_equal(found.values, factor * VALUES)
        np.testing.assert_array_equal(found.clock.time_s, times)
    assert "class cell in 'words'" in refusal("log.mat", data, "words")
    assert "4 x 3 numbers in 'table', expected a vector" in refusal("log.mat", data, "table")


def test_names_in_the_code_page_of_windows() -> None:
    name = "Federweg_ä_mm"
    (channel,) = content("log.lvm", lvm(name=name), name).channels
    assert channel.values == pytest.approx(VALUES)
    for binary in (0, 1):
        written = uff({"id1": name}, binary=binary).replace(name.encode(), name.encode("cp1252") + b" ")
        (channel,) = content("log.uff", written, name).channels
        assert channel.values == pytest.approx(VALUES, abs=1e-9)


def test_names_of_tdms_and_hdf5_in_the_code_page_of_windows() -> None:
    import h5py

    name = "Federweg_ä_mm"
    old = tdms(**{"Federweg_*_mm": {"wf_increment": 0.005}}).replace(b"_*_", b"_\xe4_")
    assert content("log.tdms", old, name).channels[0].values == pytest.approx(VALUES)
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        data = file.create_dataset(name.encode("cp1252"), data=VALUES)
        data.attrs.update({"dt": 0.005, "unit": np.bytes_("m/s²".encode("cp1252"))})
    (channel,) = content("log.h5", stream.getvalue(), name).channels
    assert channel.values == pytest.approx(VALUES)
    assert channel.unit == "m/s²"


def test_data_sets_of_hdf5_that_are_no_vectors_say_so() -> None:
    data = hdf5(time=TIME_S, words=["a", "b"], table=np.zeros((400, 3)), q_mm=VALUES)
    assert "text or dates in 'words'" in refusal("log.h5", data, "words")
    assert "400 x 3 numbers in 'table'" in refusal("log.h5", data, "table")
    everything = content("log.h5", data, everything=True)
    assert [c.name for c in everything.channels] == ["q_mm"]
    assert len(everything.left_out) == 2


def test_a_channel_without_values_is_said() -> None:
    data = tdms(q_mm={"wf_increment": 0.005}, a_g={"data": np.zeros(0), "wf_increment": 0.005})
    found = content("log.tdms", data, "q_mm", "a_g")
    assert [c.name for c in found.channels] == ["q_mm"]
    assert found.messages == ("log.tdms: the channel 'G/a_g' has no values.",)


def test_a_universal_file_that_is_cut_is_refused() -> None:
    whole = uff({}, {"id1": "a_g"})
    assert "ends before its data do" in refusal("log.uff", whole[: whole.rindex(b"-1")])
    other = b"    -1\n  9999\n 1 2 3\n    -1\n"
    assert (
        "1 data sets that are no functions of time are not read (kinds 9999)"
        in content("log.uff", whole + other, "q_mm").messages[0]
    )
