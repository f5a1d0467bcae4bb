"""Channels with clocks of their own, and what files of the formats can get wrong besides damage."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from log_files import FILES, STEP_S, csv, mdf4, readings, xlsx

from sysid.campaign import Sensor, check_quality, read_campaign, read_log
from sysid.errors import CampaignError, DataRejectedError
from sysid.logs import by_library
from sysid.logs.channels import LogRequest
from sysid.logs.input_file import InputFile, read_file
from sysid.logs.registry import FORMATS, read_channels

LVM = Path(__file__).parents[1] / "data" / "lvm"
Q = Sensor("q_mm", "suspension_deflection", "mm", axle=0)
A = Sensor("a_g", "axle_acceleration", "g", axle=0)


def read(name: str, data: bytes, sensors=(Q, A), step: float = STEP_S):
    return read_log(InputFile(Path(name), data), name, sensors, step)


# ---------------------------------------------------------------------- clocks


def two_rates() -> bytes:
    """MDF with the deflection at 200 Hz and the acceleration at 1000 Hz, a tenth of a second later."""
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    slow, fast = STEP_S * np.arange(400), 0.1 + 0.001 * np.arange(1500)
    with MDF(version="4.10") as file:
        file.append([Signal(np.sin(9.0 * slow), slow, name="q_mm", unit="mm")])
        file.append([Signal(np.cos(9.0 * fast), fast, name="a_g", unit="g")])
        file.save(stream)
    return stream.getvalue()


def test_every_channel_keeps_its_own_time() -> None:
    log = read("log.mf4", two_rates())
    q, a = log.channels
    np.testing.assert_allclose(q.time_s, STEP_S * np.arange(400), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(a.time_s, 0.1 + 0.001 * np.arange(1500), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(a.value, np.cos(9.0 * (0.1 + 0.001 * np.arange(1500))) * 9.80665)
    assert log.sample_interval_s == STEP_S
    assert any("different rates" in m for m in log.messages)


def test_two_rates_tell_a_wrong_unit_as_one_rate_does() -> None:
    """The comparison of sensors meets channels of different length."""
    from sysid.campaign.quality.sensor_trios import fit_factors

    slow, fast = STEP_S * np.arange(1200), 0.001 * np.arange(6100)

    def signals(time):
        window = np.exp(-((time - 3.0) ** 2))
        # q'' = -a of an axle under a frame that stands still.
        second = np.gradient(np.gradient(window * np.sin(60.0 * time), time), time)
        return 1e-3 * window * np.sin(60.0 * time), -1e-3 * second

    def channel(sensor, time, value):
        log = read("log.csv", csv())
        return replace(log.channels[0], sensor=sensor, time_s=time, value=value, censored=np.zeros(time.size, np.int8))

    q = channel(Q, slow, signals(slow)[0])
    a = channel(A, fast, signals(fast)[1])
    fit = fit_factors(q, a, None, STEP_S)
    assert fit is not None
    assert fit.alpha == pytest.approx(1.0, abs=0.02)


def test_left_and_right_with_different_clocks_are_averaged() -> None:
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    slow, fast = STEP_S * np.arange(400), 0.001 * np.arange(2000)
    with MDF(version="4.10") as file:
        file.append([Signal(np.sin(9.0 * slow), slow, name="l", unit="mm")])
        file.append([Signal(np.sin(9.0 * fast) + 2.0, fast, name="r", unit="mm")])
        file.save(stream)
    sides = [replace(Q, column="l", side="left"), replace(Q, column="r", side="right")]
    log = read("log.mf4", stream.getvalue(), sides)
    (mean,) = log.channels
    np.testing.assert_allclose(mean.value, 1e-3 * (np.sin(9.0 * slow) + 1.0), atol=1e-9)


# ---------------------------------------------------------------------- names


def test_a_name_in_two_groups_wants_its_group() -> None:
    from asammdf import MDF, Signal

    stream = io.BytesIO()
    time = STEP_S * np.arange(300)
    with MDF(version="4.10") as file:
        for k in (1.0, 2.0):
            file.append([Signal(k * np.sin(9.0 * time), time, name="q_mm", unit="mm")])
        file.save(stream)
    with pytest.raises(DataRejectedError, match=r"2 channels with the name 'q_mm'; name the column '(.*)' or '(.*)'"):
        read("log.mf4", stream.getvalue(), [Q])
    log = read("log.mf4", stream.getvalue(), [replace(Q, column="group 1/q_mm")])
    np.testing.assert_array_equal(log.channels[0].value, 2.0 * np.sin(9.0 * time) * 1e-3)


def test_a_missing_channel_is_suggested_by_its_near_name() -> None:
    log = read("log.mf4", mdf4(), [Q, replace(A, column="a_gg")])
    assert [c.sensor.column for c in log.channels] == ["q_mm"]
    assert "'a_gg' is missing (the file has 'a_g')" in log.messages[0]
    with pytest.raises(DataRejectedError, match="none of the sensor columns"):
        read("log.mf4", mdf4(), [replace(A, column="nothing")])


# ---------------------------------------------------------------------- units, scalings, other files


@pytest.mark.parametrize("case", ["MDF 4", "TDMS", "HDF5", "Parquet", "LVM", "UFF 58"])
def test_the_unit_in_the_file_contradicts_the_campaign(case: str) -> None:
    name, written, _ = FILES[case]
    with pytest.raises(DataRejectedError, match=r"the file says that 'q_mm' is in 'mm', campaign.toml says 'm'"):
        read(name, written(), [replace(Q, unit="m")])


def test_a_tdms_channel_with_an_unknown_scaling_is_refused() -> None:
    from nptdms import ChannelObject, TdmsWriter

    stream = io.BytesIO()
    scaled = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Sinusoidal", "NI_Scaling_Status": "unscaled"}
    with TdmsWriter(stream) as writer:
        columns = readings()
        writer.write_segment(
            [ChannelObject("log", "time_s", columns["time_s"]), ChannelObject("log", "q_mm", columns["q_mm"], scaled)]
        )
    with pytest.raises(DataRejectedError, match="raw counts with a scaling that cannot be applied"):
        read("log.tdms", stream.getvalue(), [Q])


def test_hdf5_that_keeps_its_data_elsewhere_is_refused(tmp_path: Path) -> None:
    import h5py

    (tmp_path / "secret.bin").write_bytes(np.arange(240.0).tobytes())
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time_s"] = readings()["time_s"]
        file.create_dataset("q_mm", (240,), "f8", external=[(str(tmp_path / "secret.bin"), 0, 1920)])
        file["a_g"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "a_g")
    with pytest.raises(DataRejectedError, match="keeps the data of 'q_mm' in other files"):
        read("log.h5", (tmp_path / "log.h5").read_bytes())


def test_hdf5_that_promises_more_than_is_read(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name in ("time_s", "q_mm"):
            file.create_dataset(name, (10**12,), "f8", chunks=(1000,))
    with pytest.raises(DataRejectedError, match=r"1000000000000 values in 'q_mm', at most 3000000 are read"):
        read("log.h5", (tmp_path / "log.h5").read_bytes(), [Q])


def test_cells_of_a_sheet() -> None:
    rows = [["truck 7"], ["time", "q_mm"], ["s", "mm"]] + [[STEP_S * k, float(k % 7)] for k in range(40)]
    rows[8][1] = "#N/A"
    from sysid.campaign.inputs.logs import LogWriting

    def sheet(writing):
        return read_log(InputFile(Path("log.xlsx"), xlsx(rows)), "log.xlsx", [Q], STEP_S, writing)

    log = sheet(LogWriting(units_row=True))
    assert np.flatnonzero(np.isnan(log.channels[0].value)).tolist() == [5]
    assert log.channels[0].value[6] == pytest.approx(6e-3)
    np.testing.assert_array_equal(sheet(LogWriting()).channels[0].value, log.channels[0].value)
    rows[9][1] = "mm"
    with pytest.raises(DataRejectedError, match="'mm' in row 10 of the column 'q_mm'"):
        sheet(LogWriting())


# ---------------------------------------------------------------------- LabVIEW's own files


@pytest.mark.parametrize(
    ("name", "channel", "unit", "values", "times", "count"),
    [
        ("long_single_header_multi_ch", "m_2", "m/s^2", [0.24444, 0.247439], [0.0, 0.000977], 8192),
        ("multi_time_column", "Acceleration", "g", [0.532608, 0.502991], [0.0, 1.953125e-5], 3),
        ("no_decimal_separator", "ay", "g", [-0.028189, -0.03106], [0.0, 0.00025], 4),
        ("short", "Response (Trigger)", "m/s^2", [1.204792, 1.208403], [0.0, 3.90625e-5], 10),
        ("short_new_line_end", "Excitation (Trigger)", "Newtons", [0.914018, 0.537321], [0.0, 3.90625e-5], 10),
        ("with_comments", "Volume (ml)", "ml", [0.0, 89.8214], [0.0, 0.328878], 9),
        ("with_empty_fields", "Dev0/Ai0", None, [-0.011923, -0.009206], [0.0, 0.001], 7),
    ],
)
def test_real_files_of_labview(name: str, channel: str, unit, values, times, count: int) -> None:
    """Numbers as they stand in the text of the files."""
    content = read_channels(read_file(LVM / f"{name}.lvm", 10**6), name, LogRequest((channel,)))
    (found,) = content.channels
    assert found.unit == unit
    assert found.values.size == count
    np.testing.assert_array_equal(found.values[:2], values)
    np.testing.assert_allclose(found.clock.time_s[:2], times, rtol=1e-12)


# ---------------------------------------------------------------------- extras


@pytest.mark.parametrize("log_format", [f for f in FORMATS if f.extra], ids=lambda f: f.name)
def test_a_missing_extra_is_named(log_format, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(by_library, "_spec", lambda library: False)
    with pytest.raises(CampaignError) as error:
        log_format.read(InputFile(Path("log.bin"), b""), "log.bin", LogRequest(("q",)))
    text = str(error.value)
    assert f"pip install 'truck-sysid[{log_format.extra}]'" in text
    assert text.endswith(".")
    assert "\n" not in text


def test_a_reader_that_does_not_load_is_no_fault_of_the_file() -> None:
    answer = {"error": "missing", "text": "libhdf5.so: cannot open shared object file"}
    with pytest.raises(CampaignError, match=r"whose reader cannot be loaded \(libhdf5\.so.*install it again"):
        by_library._content(answer, [], "log.mf4", "an MDF file")


# ---------------------------------------------------------------------- campaigns


def test_a_campaign_says_how_its_logs_are_written(small) -> None:
    """Keys of [acquisition] hold for all logs, those of a test for its own."""
    text = "Zeit [ms];q1_mm;a1_g\nms;mm;g\n" + "".join(f"{10 * i};{i % 7};{0.1 * (i % 5)}\n" for i in range(50))
    keys = 'sample_interval_s = 0.01\ntime = "Zeit [ms]"\nunits_row = true'
    turned = ("sample_interval_s = 0.01", keys), ('unit = "mm", range', 'unit = "mm", sign = -1, scale = 2.0, range')
    (run,) = read_campaign(small(*turned, log=text)).bump_runs
    np.testing.assert_allclose(run.log.channels[0].time_s, 0.01 * np.arange(50), atol=1e-12)
    np.testing.assert_allclose(run.log.channels[0].value, [-2e-3 * (i % 7) for i in range(50)], rtol=1e-12)
    own = ('file = "run.csv"', 'file = "run.csv", time = "t", units_row = false')
    plain = text.replace("Zeit [ms]", "t").replace("ms;mm;g\n", "")
    with pytest.raises(DataRejectedError, match="probably in ms"):
        read_campaign(small(*turned, own, log=plain))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("sample_interval_s = 0.01", 'sample_interval_s = 0.01\nformat = "mfd"', "did you mean 'mdf'"),
        ('unit = "mm", range', 'unit = "mm", sign = 2, range', "sign"),
        ('unit = "mm", range', 'unit = "mm", scale = -1.0, range', "scale"),
        ('file = "run.csv"', 'file = "run.csv", time = ""', "time"),
    ],
)
def test_wrong_keys_about_logs_are_named(small, old: str, new: str, said: str) -> None:
    with pytest.raises(CampaignError, match=said):
        read_campaign(small((old, new)))


def test_a_binary_log_passes_the_quality_check(small) -> None:
    columns = (("q1_mm =", "q_mm ="), ("a1_g =", "a_g ="), ("= 0.01", "= 0.005"), ("run.csv", "run.mf4"))
    file = small(*columns)
    (file.parent / "run.mf4").write_bytes(two_rates())
    checked, report = check_quality(read_campaign(file))
    assert {c.column: round(c.rate_hz) for c in report.channels} == {"q_mm": 200, "a_g": 1000}
    assert "run.mf4" in checked.input_sha256
