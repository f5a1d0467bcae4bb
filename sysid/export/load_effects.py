"""Load effects on bridges as tables: extremes with their intervals beside load models of codes, and histories."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.csv_cells import columns_text, csv_text, escape_cell, number_cell
from sysid.export.naming import prediction_files, speed_km_h
from sysid.files import write_text

if TYPE_CHECKING:
    from sysid.prediction.bridge_effects import BridgeLoads, LoadEffect
    from sysid.prediction.predicted_passes import PassPrediction

_BANDS = ("static", "rolling", "dynamic", "amplification")


def load_effects_csv(passes: Iterable[PassPrediction], trust: str | None = None) -> str:
    """The text of a table of load effects: a row per pass, load effect and sense, in SI units.

    Each has quantiles over draws and surfaces of the static effect, of that of rolling axle loads and of the dynamic
    one, their amplification, where axle 1 is at the extreme, per load model of a code its effect and the median over
    it, and whether the numbers may be used.
    """
    of_bridges = [p for p in passes if p.bridge is not None]
    models = list(dict.fromkeys(c.model for p in of_bridges for e in _effects(p) for c in e.codes))
    rows: list[list[object]] = []
    for p in of_bridges:
        assert p.bridge is not None
        head = [escape_cell(p.load_case), speed_km_h(p.speed_m_s), escape_cell(p.bridge.bridge)]
        head += [escape_cell(p.bridge.surface), p.bridge.vehicles]
        for e in _effects(p):
            codes = {c.model: c.value for c in e.codes}
            row = [*head, escape_cell(e.name), e.sense, e.unit]
            for name in _BANDS:
                band = getattr(e, name)
                row += [number_cell(None if q is None else float(q[0])) for q in (band.q05, band.q50, band.q95)]
            row.append(number_cell(e.front_m))
            for model in models:
                value = codes.get(model)
                row += [number_cell(value), number_cell(_over(e, value))]
            rows.append([*row, trust or ""])
    names = ["load_case", "speed_km_h", "bridge", "surface", "vehicles", "effect", "sense", "unit"]
    names += [f"{name}_{q}" for name in _BANDS for q in ("q05", "q50", "q95")]
    names += ["front_axle_m", *(f"{kind}_{m.replace(' ', '')}" for m in models for kind in ("code", "over"))]
    return csv_text((*names, "verdict"), rows)


def concurrent_csv(passes: Iterable[PassPrediction]) -> str:
    """The text of a table of concurrent load effects: what all of them are where one is largest or least, medians."""
    rows = []
    for p in passes:
        if p.bridge is None:
            continue
        for e in p.bridge.effects:
            head = [escape_cell(p.load_case), speed_km_h(p.speed_m_s), escape_cell(p.bridge.bridge)]
            for name, unit, value in zip(p.bridge.names, p.bridge.units, e.concurrent, strict=True):
                row = [escape_cell(e.name), e.sense, escape_cell(name), unit, number_cell(float(value))]
                rows.append([*head, *row])
    return csv_text(
        ("load_case", "speed_km_h", "bridge", "extreme_of", "sense", "concurrent_effect", "unit", "value"), rows
    )


def effect_histories_csv(loads: BridgeLoads) -> str:
    """The text of histories: time [s] from axle 1 at the first support, per load effect its static value and bands."""
    columns: dict[str, np.ndarray] = {"time_s": np.round(loads.time_s, 6)}
    for k, (name, unit) in enumerate(zip(loads.names, loads.units, strict=True)):
        title = escape_cell(f"{name} [{unit}]")
        columns[f"{title} static"] = loads.static[k]
        for key, band in (("q05", loads.history.q05), ("q50", loads.history.q50), ("q95", loads.history.q95)):
            columns[f"{title} {key}"] = np.full(len(loads.time_s), np.nan) if band is None else band[k]
    return columns_text(columns)


def load_effect_texts(passes: Sequence[PassPrediction], table: str, trust: str | None = None) -> dict[str, str]:
    """Texts of the passes over bridges by file below the output folder, the common tables named `table`."""
    if not any(p.bridge is not None for p in passes):
        return {}
    texts = {
        f"predictions/{table}.csv": load_effects_csv(passes, trust),
        f"predictions/{table}_concurrent.csv": concurrent_csv(passes),
    }
    for p, name in zip(passes, prediction_files(passes), strict=True):
        if p.bridge is not None:
            texts[f"{name.removesuffix('.csv')}_effects.csv"] = effect_histories_csv(p.bridge)
    return texts


def write_load_effects(
    passes: Sequence[PassPrediction], folder: Path, table: str, trust: str | None = None
) -> tuple[Path, ...]:
    """Write the tables of passes over bridges below the output `folder`, and return the paths; none without any."""
    texts = load_effect_texts(passes, table, trust)
    for name, text in texts.items():
        write_text(folder / name, text)
    return tuple(folder / name for name in texts)


def load_effect_documents(passes: Sequence[PassPrediction]) -> list[dict[str, Any]]:
    """Load effects for `result.json`: one object per pass, effect and sense."""
    found = []
    for p, file in zip(passes, prediction_files(passes), strict=True):
        for e in _effects(p):
            assert p.bridge is not None
            quantiles = {
                name: {q: _quantile(getattr(getattr(e, name), q)) for q in ("q05", "q50", "q95")} for name in _BANDS
            }
            codes = {c.model: {"value": float(c.value), "over": _over(e, c.value)} for c in e.codes}
            found.append(
                {
                    "load_case": p.load_case,
                    "speed_km_h": speed_km_h(p.speed_m_s),
                    "bridge": p.bridge.bridge,
                    "surface": p.bridge.surface,
                    "vehicles": p.bridge.vehicles,
                    "effect": e.name,
                    "sense": e.sense,
                    "unit": e.unit,
                    **quantiles,
                    "front_axle_m": e.front_m,
                    "codes": codes,
                    "file": f"{file.removesuffix('.csv')}_effects.csv",
                }
            )
    return found


def _effects(p: PassPrediction) -> tuple[LoadEffect, ...]:
    return () if p.bridge is None else p.bridge.effects


def _over(effect: LoadEffect, code: float | None) -> float | None:
    """Median over a code's effect; None where that is of the other sense or nothing."""
    if code is None or code * float(effect.static.q50[0]) <= 0.0:
        return None
    return float(effect.dynamic.q50[0]) / code


def _quantile(values: np.ndarray | None) -> float | None:
    return None if values is None else float(values[0])
