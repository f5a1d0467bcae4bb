"""Axle loads over rough roads as tables: spectra, range pairs, the load along the road, and what repeats there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.csv_cells import csv_text, escape_cell, number_cell
from sysid.export.naming import prediction_files, speed_km_h
from sysid.prediction.road_measures import passes_of_one_road, repeatability

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, RoadLoads
    from sysid.prediction.quantiles import Quantiles

_BANDS = ("q05", "q50", "q95")


def road_texts(passes: Sequence[PassPrediction], name: str, trust: str | None = None) -> dict[str, str]:
    """Texts of all tables of passes over rough roads by their files in the output folder; none without such passes.

    Parameters
    ----------
    name : of the table that passes over one road share; trust : whether the numbers may be used.
    """
    texts: dict[str, str] = {}
    for p, file in zip(passes, prediction_files(passes), strict=True):
        if p.road is not None:
            stem = file.removesuffix(".csv")
            texts[f"{stem}_spectra.csv"] = spectra_csv(p.road)
            texts[f"{stem}_ranges.csv"] = ranges_csv(p.road, p.static_load_N)
            texts[f"{stem}_along.csv"] = along_csv(p.road)
    if texts:
        texts[f"predictions/{name}.csv"] = repeatability_csv(passes, trust)
    return texts


def spectra_csv(road: RoadLoads) -> str:
    """The text of a table of load spectra: a row per frequency [Hz], per axle quantiles of the density [kN2/Hz]."""
    axles = range(len(road.spectrum_N2_Hz.q50))
    names = [f"axle_load{i + 1}_kN2_per_Hz_{q}" for i in axles for q in _BANDS]
    rows = [
        [number_cell(f), *(cell for i in axles for cell in _cells(road.spectrum_N2_Hz, (i, k), 1e-6))]
        for k, f in enumerate(road.frequency_hz)
    ]
    return csv_text(("frequency_hz", *names), rows)


def ranges_csv(road: RoadLoads, static_N: np.ndarray) -> str:
    """The text of a table of range pairs: a row per axle, force and range [kN], quantiles of the count per km."""
    forces = (("axle_load", road.tire_ranges_per_km), ("suspension_force", road.suspension_ranges_per_km))
    rows = [
        [i + 1, force, number_cell(1e-3 * static * level), number_cell(level), *_cells(counts, (i, k), 1.0)]
        for i, static in enumerate(static_N)
        for force, counts in forces
        for k, level in enumerate(road.range_levels)
    ]
    return csv_text(("axle", "force", "range_kN", "range_over_static", *(f"more_per_km_{q}" for q in _BANDS)), rows)


def along_csv(road: RoadLoads) -> str:
    """The text of a table of the load along the road: a row per station [m], quantiles of all axle loads there [kN]."""
    several = road.aggregate_N.shape[1] > 1
    bands = np.quantile(road.aggregate_N, [0.05, 0.5, 0.95], axis=1) if several else road.aggregate_N.T
    columns = 1e-3 * np.asarray(bands, float)
    names = _BANDS if several else ("q50",)
    rows = [[f"{s:.3f}", *(f"{x:.4g}" for x in row)] for s, row in zip(road.station_m, columns.T, strict=True)]
    return csv_text(("station_m", *(f"aggregate_load_kN_{q}" for q in names)), rows)


def repeatability_csv(passes: Sequence[PassPrediction], trust: str | None = None) -> str:
    """The text of a table of spatial repeatability: a row per two passes over one road, or draws of one pass."""
    rows: list[list[object]] = []
    for a, b in passes_of_one_road(passes):
        assert a.road is not None
        assert b.road is not None
        first, other, between = a.road.aggregate_N, b.road.aggregate_N, "passes"
        if a is b:
            if first.shape[1] < 2:
                continue
            other, between = np.broadcast_to(first.mean(axis=1, keepdims=True), first.shape), "draws and their mean"
        pair = [cell for p in (a, b) for cell in (escape_cell(p.load_case), speed_km_h(p.speed_m_s))]
        rows.append([escape_cell(a.shape), *pair, between, *_cells(repeatability(first, other), 0, 1.0), trust or ""])
    names = ("road", "load_case", "speed_km_h", "other_load_case", "other_speed_km_h", "between")
    return csv_text((*names, *(f"repeatability_{q}" for q in _BANDS), "verdict"), rows)


def _cells(values: Quantiles, index: int | tuple[int, int], factor: float) -> list[str]:
    bands = (values.q05, values.q50, values.q95)
    return [number_cell(None if q is None else factor * float(q[index])) for q in bands]
