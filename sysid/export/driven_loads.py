"""Axle loads of road drives as tables: load coefficients and spectra."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.csv_cells import csv_text, escape_cell, number_cell
from sysid.files import write_text

if TYPE_CHECKING:
    from sysid.balance.records import AxleLoads
    from sysid.results.contents import Results

LOADS_FILE, SPECTRA_FILE = "axle_loads.csv", "axle_load_spectra.csv"


def write_driven_loads(results: Results, folder: Path) -> list[Path]:
    """Write the tables of a balance of road drives into a folder; nothing where there is none."""
    loads = () if results.balance is None else results.balance.loads
    if not loads:
        return []
    write_text(folder / LOADS_FILE, coefficients_csv(loads))
    write_text(folder / SPECTRA_FILE, driven_spectra_csv(loads))
    return [folder / LOADS_FILE, folder / SPECTRA_FILE]


def coefficients_csv(loads: Sequence[AxleLoads]) -> str:
    """The text of `axle_loads.csv`: a row per log and axle, load at rest [N] and load coefficient with quantiles."""
    rows = [
        [escape_cell(d.file), escape_cell(d.load_case), i + 1, number_cell(d.used_s), number_cell(d.static_N[i]),
         *(number_cell(x[i]) for x in (d.low, d.coefficient, d.high))]
        for d in loads for i in range(len(d.static_N))
    ]  # fmt: skip
    quantiles = (f"load_coefficient_{q}" for q in ("q05", "q50", "q95"))
    return csv_text(("file", "load_case", "axle", "used_s", "static_load_N", *quantiles), rows)


def driven_spectra_csv(loads: Sequence[AxleLoads]) -> str:
    """The text of `axle_load_spectra.csv`: a row per log and frequency [Hz], quantiles of densities [kN2/Hz]."""
    axles = range(max(len(d.static_N) for d in loads))
    names = [f"axle_load{i + 1}_kN2_per_Hz_{q}" for i in axles for q in ("q05", "q50", "q95")]
    rows = [
        [escape_cell(d.file), escape_cell(d.load_case), number_cell(f),
         *(number_cell(1e-6 * x[i, k]) for i in axles for x in (d.density_low, d.density, d.density_high))]
        for d in loads for k, f in enumerate(d.frequency_hz)
    ]  # fmt: skip
    return csv_text(("file", "load_case", "frequency_hz", *names), rows)
