"""Tables of predicted axle loads: passes that nobody drove, and the ratio against speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.export import prediction_files
from sysid.numbers import MISSING, decimals, fixed, interval, number, speed
from sysid.report.cells import Cell, Table, axle_name, table
from sysid.results.contents import Results
from sysid.results.pass_limits import TRUST_WORDS, pass_name

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction, SpeedSweep
    from sysid.prediction.quantiles import Quantiles
    from sysid.prediction.trust import Extrapolation


def prediction_tables(results: Results) -> list[Table]:
    """Peak axle loads of every predicted pass."""
    if results.predictions is None:
        return []
    tables = []
    passes = results.predictions.passes
    kind = "90 % credible interval" if results.predictions.source == "posterior" else "least squares, no interval yet"
    for p, file in zip(passes, prediction_files(passes), strict=True):
        rows = []
        for i, static in enumerate(p.static_load_N):
            ratio = float(p.peak_ratio_q50[i])
            low, high = (None if q is None else float(q[i]) for q in (p.peak_ratio_q05, p.peak_ratio_q95))
            load = float(static) / 1e3
            places = decimals(ratio * load)
            force = interval(None if low is None else low * load, None if high is None else high * load, places)
            rows.append(
                [
                    axle_name(results, i),
                    number(load),
                    Cell(fixed(ratio, 2), interval(low, high, 2)),
                    Cell(fixed(ratio * load, places), force),
                    _band(p.load_coefficient, i, 2),
                    "yes" if p.lift_off[i] else "no",
                    _band(p.lift_off_s, i, 0, 1e3),
                    _travel(p.jounce_m, i, results.campaign.vehicle.axles[i].jounce_travel_m),
                    _travel(p.rebound_m, i, results.campaign.vehicle.axles[i].rebound_travel_m),
                    _band(p.impulse_ratio, i, 3),
                    *_wheel_bands(p, i),
                ]
            )
        head = (
            "axle",
            "static load [kN]",
            "peak / static load [-]",
            "peak axle load [kN]",
            "dynamic load coefficient [-]",
            "leaves the ground",
            "off the ground [ms]",
            "compression [mm]",
            "extension [mm]",
            "mean / static load [-]",
            *(() if p.wheels is None else (f"peak {side} wheel load [kN]" for side in p.wheels.sides)),
        )
        caption = f"{pass_name(p)}: peak axle loads, both sides together ({kind}); histories in {file}"
        tables.append(table(caption, head, rows))
    return tables


#: Load effects on the page: factor from SI, unit and decimals.
_EFFECT_UNITS = {"N m": (1e-3, "kN m", 0), "N": (1e-3, "kN", 1), "m": (1e3, "mm", 2), "": (1.0, "", 3)}


def effect_tables(results: Results) -> list[Table | None]:
    """Load effects of every predicted pass over a bridge beside load models of codes; None for a pass over none."""
    passes = () if results.predictions is None else results.predictions.passes
    tables: list[Table | None] = []
    for p in passes:
        if p.bridge is None or not p.bridge.effects:
            tables.append(None)
            continue
        rows = []
        for e in p.bridge.effects:
            factor, unit, places = _EFFECT_UNITS[e.unit]
            values = (_band(q, 0, places, factor) for q in (e.static, e.rolling, e.dynamic))
            over = (
                None if c.value * float(e.static.q50[0]) <= 0.0 else float(e.dynamic.q50[0]) / c.value for c in e.codes
            )
            codes = (MISSING if share is None else fixed(share, 2) for share in over)
            rows.append([Cell(e.name, note=e.sense), unit, *values, _band(e.amplification, 0, 3), *codes])
        models = (f"over {c.model} [-]" for c in p.bridge.effects[0].codes)
        head = ("load effect", "unit", "static", "rolling", "dynamic", "dynamic / static [-]", *models)
        caption = (
            f"{pass_name(p)}: load effects; static: at rest, rolling: dynamic axle loads on a bridge that does not "
            "move, dynamic: truck and bridge together; over the load models of codes for one lane, with their allowance"
        )
        tables.append(table(caption, head, rows, text_columns=2))
    return tables


def trust_tables(results: Results) -> list[Table | None]:
    """What of every predicted pass goes beyond the driven runs, axle by axle; None for a pass within them."""
    passes = () if results.predictions is None else results.predictions.passes
    head = ("axle", *(f"{words} [{unit}]" for words, _, unit in TRUST_WORDS.values()))
    tables: list[Table | None] = []
    for p in passes:
        beyond = {(e.what, e.axle): e for e in p.trust}
        rows = [
            [axle_name(results, i), *(_beyond(beyond.get((what, i)), TRUST_WORDS[what][1]) for what in TRUST_WORDS)]
            for i in range(len(p.static_load_N))
        ]
        caption = "What the pass reaches where it goes beyond the driven runs; in brackets the most that was driven"
        tables.append(table(caption, head, rows) if beyond else None)
    return tables


def _beyond(e: Extrapolation | None, factor: float) -> Cell:
    return Cell("within") if e is None else Cell(number(factor * e.reached), f"[{number(factor * e.driven)}]")


def _band(values: Quantiles | None, axle: int | tuple[int, int], places: int, factor: float = 1.0) -> Cell:
    if values is None:
        return Cell(MISSING)
    low, high = (None if q is None else factor * float(q[axle]) for q in (values.q05, values.q95))
    return Cell(fixed(factor * float(values.q50[axle]), places), interval(low, high, places))


def _wheel_bands(p: PassPrediction, axle: int) -> list[Cell]:
    """Peak load of left and right wheels, where the fit knows of roll."""
    if p.wheels is None:
        return []
    return [_band(p.wheels.of_side(side).peak_N, axle, 1, 1e-3) for side in range(len(p.wheels.sides))]


def _travel(values: Quantiles | None, axle: int, declared_m: float | None) -> Cell:
    band = _band(values, axle, 0, 1e3)
    return Cell(band.text, band.interval, "none declared" if declared_m is None else f"of {1e3 * declared_m:.0f}")


def sweep_name(results: Results, sweep: SpeedSweep) -> str:
    """Load case of passes at several speeds, with the bump where there are several."""
    return sweep.load_case if len(results.campaign.scans) < 2 else f"{sweep.load_case}, {sweep.bump}"


def sweep_tables(results: Results) -> list[Table]:
    """Peak load ratio against speed, a table per load case."""
    sweeps = () if results.predictions is None else results.predictions.sweeps
    tables = []
    for s in sweeps:
        axles = range(s.peak_ratio.q50.shape[1])
        rows = [
            [f"{speed(float(v))}", *(_band(s.peak_ratio, (i, axle), 2) for axle in axles)]
            for i, v in enumerate(s.speed_m_s)
        ]
        head = ("speed [km/h]", *(f"axle {axle + 1} [-]" for axle in axles))
        tables.append(table(f"{sweep_name(results, s)}: peak dynamic load ratio against speed", head, rows))
    return tables
