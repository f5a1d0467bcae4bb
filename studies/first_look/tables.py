"""Columns of a log with what is true of them, and eight ways to write them into a file."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

#: What is true of a column: kind, unit as a campaign file writes it, axle and side; None where that says nothing.
Truth = tuple[str, str | None, int | None, str | None]
#: Units that are written in several ways.
WRITTEN = {"kph": "km/h", "°/s": "deg/s"}


@dataclass
class Table:
    """Columns on one clock, with their units and what is true of them."""

    time_s: np.ndarray
    values: dict[str, np.ndarray] = field(default_factory=dict)
    unit: dict[str, str] = field(default_factory=dict)
    truth: dict[str, Truth] = field(default_factory=dict)

    def add(
        self, name: str, values: np.ndarray, unit: str, kind: str, axle: int | None = None, side: str | None = None
    ) -> None:
        """Add a column; a name that is taken keeps its first one."""
        if name not in self.values:
            self.values[name], self.unit[name] = values, unit
            self.truth[name] = (kind, None if kind == "unused" else WRITTEN.get(unit, unit), axle, side)

    def named(self, form: str) -> pd.DataFrame:
        """The columns with their units in the names as `form` says, such as ``{} [{}]``."""
        names = {n: form.format(n, u) if u else n for n, u in self.unit.items()}
        return pd.DataFrame({names[n]: v for n, v in self.values.items()})


@dataclass(frozen=True)
class Format:
    """One way to write a log: `write` returns what is true of the columns by their names in the file."""

    suffix: str
    write: Callable[[Path, Table], dict[str, Truth]]


def _text(path: Path, table: Table) -> dict[str, Truth]:
    frame = table.named("{} [{}]")
    frame.insert(0, "time_s", table.time_s)
    frame.to_csv(path, index=False, float_format="%.6g")
    return dict(zip(frame.columns[1:], table.truth.values(), strict=True))


def _semicolons(path: Path, table: Table) -> dict[str, Truth]:
    """As a logger in German: semicolons, commas, a row of units, Windows code page."""
    rows = [";".join(["Zeit", *table.values]), ";".join(["s", *table.unit.values()])]
    values = np.column_stack([table.time_s, *table.values.values()])
    rows += [";".join(f"{v:.6g}" for v in row).replace(".", ",") for row in values]
    path.write_text("\n".join(rows) + "\n", encoding="cp1252", errors="replace")
    return dict(table.truth)


def _tabs(path: Path, table: Table) -> dict[str, Truth]:
    """Units in round brackets, tabs, UTF-16."""
    frame = table.named("{} ({})")
    frame.insert(0, "Time (s)", table.time_s)
    frame.to_csv(path, index=False, sep="\t", encoding="utf-16", float_format="%.6g")
    return dict(zip(frame.columns[1:], table.truth.values(), strict=True))


def _mdf(path: Path, table: Table) -> dict[str, Truth]:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(v, table.time_s, name=n, unit=table.unit[n]) for n, v in table.values.items()])
        file.save(path, overwrite=True)
    return dict(table.truth)


def _tdms(path: Path, table: Table) -> dict[str, Truth]:
    from nptdms import ChannelObject, TdmsWriter

    columns = {"Time": table.time_s, **{n.replace("/", "-"): v for n, v in table.values.items()}}
    units = {"Time": "s", **{n.replace("/", "-"): u for n, u in table.unit.items()}}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("log", n, v, {"unit_string": units[n]}) for n, v in columns.items()])
    return {n.replace("/", "-"): t for n, t in table.truth.items()}


def _mat(path: Path, table: Table) -> dict[str, Truth]:
    """Names as MATLAB takes them, units in them."""
    from scipy.io import savemat

    short = {n: re.sub(r"\W+", "_", f"{n[:22]}_{table.unit[n]}".replace("^", "")).strip("_") for n in table.values}
    savemat(path, {"t": table.time_s, **{short[n]: v for n, v in table.values.items()}}, do_compression=True)
    return {short[n]: truth for n, truth in table.truth.items()}


def _parquet(path: Path, table: Table) -> dict[str, Truth]:
    frame = table.named("{}_{}")
    frame.insert(0, "time_s", table.time_s)
    frame.to_parquet(path)
    return dict(zip(frame.columns[1:], table.truth.values(), strict=True))


def _hdf5(path: Path, table: Table) -> dict[str, Truth]:
    import h5py

    names = {n: n.replace("/", "-") for n in table.values}
    with h5py.File(path, "w") as file:
        file["time"] = table.time_s
        file["time"].attrs["units"] = "s"
        for name, values in table.values.items():
            file[names[name]] = values
            file[names[name]].attrs["units"] = table.unit[name]
    return {names[n]: truth for n, truth in table.truth.items()}


FORMATS = {
    "CSV": Format("csv", _text),
    "semicolons and a row of units": Format("txt", _semicolons),
    "tabs, UTF-16": Format("tsv", _tabs),
    "MDF 4": Format("mf4", _mdf),
    "TDMS": Format("tdms", _tdms),
    "MAT": Format("mat", _mat),
    "Parquet": Format("parquet", _parquet),
    "HDF5": Format("h5", _hdf5),
}
