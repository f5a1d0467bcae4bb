"""Numbers that loggers write where they have no reading are missing, in every format; readings far away are not."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from sysid.logs.channels import LogRequest
from sysid.logs.input_file import InputFile
from sysid.logs.registry import read_channels

TIME_S = 0.005 * np.arange(400)
SOUND = np.round(12.0 * np.sin(9.0 * TIME_S), 3)


def csv(values: np.ndarray) -> tuple[str, bytes]:
    rows = "".join(f"{t:.3f},{v!r}\n" for t, v in zip(TIME_S.tolist(), values.tolist(), strict=True))
    return "log.csv", ("time_s,q_mm\n" + rows).encode()


def mat(values: np.ndarray) -> tuple[str, bytes]:
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, {"time_s": TIME_S, "q_mm": values})
    return "log.mat", stream.getvalue()


def hdf5(values: np.ndarray) -> tuple[str, bytes]:
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file["time_s"], file["q_mm"] = TIME_S, values
    return "log.h5", stream.getvalue()


def read(file: tuple[str, bytes]) -> tuple[np.ndarray, tuple[str, ...]]:
    name, data = file
    content = read_channels(InputFile(Path(name), data), name, LogRequest(("q_mm",)))
    return content.channels[0].values, content.messages


@pytest.mark.parametrize("write", [csv, mat, hdf5])
@pytest.mark.parametrize("code", [-9999.0, 32767.0, 9.9e37, -999.25])
def test_codes_are_missing_and_counted(write, code: float) -> None:
    lost = np.array([7, 8, 9, 10, 200, 399])
    given = SOUND.copy()
    given[lost] = code
    values, said = read(write(given))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), lost)
    np.testing.assert_array_equal(np.delete(values, lost), np.delete(SOUND, lost))
    assert [s for s in said if f"6 of its readings are {code:.10g}, an error code" in s]


def test_codes_at_both_ends_and_one_behind_the_other() -> None:
    given = SOUND.copy()
    given[[20, 30]], given[40], given[50] = -9999.0, 9999.0, 99999.0
    values, _ = read(csv(given))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), [20, 30, 40, 50])


@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("a rail that is no code", np.where(np.arange(400) % 50 == 0, 150.0, SOUND)),
        ("nines near the others", np.where(np.arange(400) % 50 == 0, 999.0, 40.0 * SOUND)),
        ("a step after a record that stands still", np.where(np.arange(400) < 200, 0.0, 999.0)),
        ("raw counts that end at their largest number", np.linspace(-32768.0, 32767.0, 400)),
    ],
)
def test_readings_are_no_codes(what: str, values: np.ndarray) -> None:
    read_back, said = read(csv(values))
    np.testing.assert_array_equal(read_back, values)
    assert not said, what
