"""Pictures of the first screen: the truck with its numbers, the worst channel, and axle loads against speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sysid import plot
from sysid.display import NOT_DETERMINED
from sysid.estimation.fit.thresholds import MISFIT
from sysid.numbers import MISSING, count, decimals, fixed, listing, number, speed
from sysid.report.figures import Gallery, Picture, run_words
from sysid.report.load_tables import sweep_name
from sysid.results import Results
from sysid.results.headline import (
    PeakLoad,
    SuspensionRow,
    in_thousands,
    largest_at_any_speed,
    largest_loads,
    static_loads_N,
    suspension_rows,
)

if TYPE_CHECKING:
    from sysid.estimates.suspension_values import Estimate
    from sysid.estimation.residuals.run_history import RunHistory
    from sysid.validation.channel_agreement import ChannelAgreement


#: Row of the loads below the drawing.
_PEAKS = 2


@dataclass(frozen=True)
class TruckRows:
    """What stands below the axles of the drawing: heads and one text per axle, row and axle of the largest load (None
    without loads), and a caption; no texts before any value is known.
    """

    texts: list[tuple[str, list[str]]]
    highest: tuple[int, int] | None
    caption: str


def truck_rows(results: Results) -> TruckRows:
    """k, c and loads of every axle for the drawing of the truck."""
    of_axles = suspension_rows(results)
    if not of_axles:
        return TruckRows([], None, "")
    anywhere, driven = (largest_at_any_speed(results, as_driven=only) for only in (False, True))
    # Without a speed that the runs back, and before any sweep, the passes that the campaign file asks for.
    backed = any(driven)
    loads = driven if backed else largest_loads(results)
    rows = [
        ("spring k [kN/m]", _per_axle(results, of_axles, "stiffness")),
        ("damper c [kN s/m]", _per_axle(results, of_axles, "damping")),
    ]
    if loads:
        rows += [
            ("peak as driven [kN]" if backed else "peak in pass [kN]", [_peak(load) for load in loads]),
            ("static [kN] (peak in %)", [_static(load) for load in loads]),
        ]
        if any(anywhere):
            rows.append((f"computed to {_fastest(results)} km/h", [_peak(load) for load in anywhere]))
    else:
        case = next(iter(results.campaign.load_cases.values()))
        gravity = results.campaign.vehicle.gravity_m_s2
        rows.append(("static load [kN]", [fixed(gravity * mass / 1e3, 1) for mass in case.axle_loads_kg]))
    peaks = [0.0 if load is None else load.peak_N for load in loads]
    highest = (_PEAKS, int(np.argmax(peaks))) if any(peaks) else None
    kinds = dict.fromkeys(e.kind for row in of_axles for e in (row.stiffness, row.damping) if e)
    caption = (
        f"k, c and loads are of both sides of an axle together; ± is half of the {listing(list(kinds))}. One value "
        "holds for all load cases. c: mean of both directions at 0.5 m/s, without friction."
    )
    if loads and results.predictions is not None:
        passes = count(len(results.predictions.passes), "predicted pass", "predicted passes")
        caption += (
            " Peak as driven: the largest at any speed at which nothing goes beyond the driven runs, and where"
            if backed
            else f" Peak in pass: the largest of {passes} over the bump, and in which"
        )
        caption += "; static: the load at rest in that load case, the peak in per cent of it; shaded: the largest."
        if any(anywhere):
            caption += f" Last row [kN]: the largest that the model computes at any speed to {_fastest(results)} km/h."
        if any(load and load.beyond for load in (*loads, *anywhere)):
            caption += " * not driven: an extrapolation beyond the driven runs."
    return TruckRows(rows, highest, caption)


def truck_picture(results: Results, gallery: Gallery) -> list[Picture]:
    """The truck to scale, below each axle k, c and its largest load; nothing before any value is known."""
    rows = truck_rows(results)
    if not rows.texts:
        return []
    words = [f"{head}: {', '.join(f'axle {i + 1} {t}' for i, t in enumerate(texts))}." for head, texts in rows.texts]
    draws = partial(plot.truck, results.campaign.vehicle, rows.texts, rows.highest)
    return [gallery.picture(draws, rows.caption, " ".join([rows.caption, *words]), width="wide truck")]


def _fastest(results: Results) -> str:
    assert results.predictions is not None
    return speed(max(float(sweep.speed_m_s.max()) for sweep in results.predictions.sweeps))


def _per_axle(results: Results, rows: tuple[SuspensionRow, ...], quantity: str) -> list[str]:
    """The values of each axle, one line per load case where they differ."""
    texts = []
    for axle in range(len(results.campaign.vehicle.axles)):
        found = [(row.load_case, getattr(row, quantity)) for row in rows if row.axle == axle]
        values = [(case, _value(e)) for case, e in found if e is not None and math.isfinite(e.value)]
        if len({text for _, text in values}) <= 1:
            values = values[:1]
        several = len(values) > 1
        texts.append("\n".join(f"{t} {case}" if several and case else t for case, t in values) or MISSING)
    return texts


def _value(e: Estimate) -> str:
    if not e.identified:
        return NOT_DETERMINED
    value, half = e.value / 1e3, (e.high - e.low) / 2e3
    # Three digits: the tables have the rest.
    places = decimals(value)
    return fixed(value, places) + (f" ± {fixed(half, max(places, decimals(half, digits=1)))}" if half >= 0.0 else "")


def _peak(load: PeakLoad | None) -> str:
    if load is None:
        return MISSING
    value = in_thousands(load.peak_N, load.low_N, load.high_N) + ("*" if load.beyond else "")
    return f"{value}\n{load.pass_name}"


def _static(load: PeakLoad | None) -> str:
    return MISSING if load is None else f"{fixed(load.static_N / 1e3, 1)} ({fixed(100.0 * load.ratio, 0)} %)"


def worst_picture(results: Results, gallery: Gallery) -> list[Picture]:
    """The channel record in which simulation and measurement differ most, in units of the sensor's noise."""
    if results.fit is None:
        return []
    histories = {h.file: h for h in results.fit.histories}
    rows = [] if results.validation is None else list(results.validation.channels)
    known = [r for r in rows if r.run in histories and r.column in histories[r.run].columns]
    known = [r for r in known if math.isfinite(r.residual_over_noise)]
    if not known:
        return []
    worst = max(known, key=lambda r: r.residual_over_noise)
    history = histories[worst.run]
    caption = (
        f"The worst of {count(len(known), 'channel record')}: {_channel(worst, history)} of {run_words(history)}. Its "
        f"residual is {number(worst.residual_over_noise, 2)} times what the sensor shows before the bump "
        f"(median of all: {number(float(np.median([r.residual_over_noise for r in known])), 2)}; 1 is noise alone, "
        f"from {MISFIT:g} on the model limits the accuracy)."
    )
    return [gallery.picture(partial(plot.overlay, history, worst.column), caption, width="half")]


def _channel(row: ChannelAgreement, history: RunHistory) -> str:
    title = plot.channel_title(history, history.columns.index(row.column))
    return title.rpartition(" (")[0]


def speed_picture(results: Results, gallery: Gallery) -> list[Picture]:
    """Axle loads against speed, of the load case with the largest; before sweeps nothing."""
    sweeps = () if results.predictions is None else results.predictions.sweeps
    if not sweeps:
        return []
    sweep = max(sweeps, key=lambda s: float(np.nanmax(static_loads_N(results, s) * s.peak_ratio.q50)))
    driven = sweep.driven_m_s
    caption = f"Peak axle loads against speed, {sweep_name(results, sweep)}. " + (
        "No run was driven in this load case."
        if driven is None
        else f"Shaded: driven, {speed(driven[0])} to {speed(driven[1])} km/h. Open marks: beyond what the driven runs "
        "reached, an extrapolation."
    )
    draws = partial(plot.axle_load_against_speed, sweep, static_loads_N(results, sweep))
    return [gallery.picture(draws, caption, width="half")]
