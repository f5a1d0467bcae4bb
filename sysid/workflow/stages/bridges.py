"""What the screen shows of load effects on a bridge."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.display import TextTable

if TYPE_CHECKING:
    from sysid.prediction.bridge_effects import BridgeLoads, LoadEffect
    from sysid.prediction.predicted_passes import PassPrediction
    from sysid.prediction.quantiles import Quantiles
    from sysid.workflow.stage import Blocks

#: Units on the screen: factor from SI, unit and decimals.
_SHOWN = {"N m": (1e-3, "kN m", 1), "N": (1e-3, "kN", 1), "m": (1e3, "mm", 3), "": (1.0, "", 4)}


def shown_bridge(p: PassPrediction, loads: BridgeLoads) -> Blocks:
    """Load effects of one pass, at rest and with the motion of vehicle and bridge, and beside load models of codes."""
    table = TextTable(
        f"{p.load_case}, {3.6 * p.speed_m_s:.4g} km/h, {p.shape}: largest load effects",
        ("load effect", "unit", "static", "rolling", "dynamic", "90 % interval", "amplification", "90 % interval",
         "axle 1 at m"),
    )  # fmt: skip
    for e in loads.effects:
        factor, unit, places = _SHOWN.get(e.unit, _SHOWN[""])
        table.add_row(
            e.title,
            unit,
            *(f"{factor * getattr(e, name).q50[0]:.{places}f}" for name in ("static", "rolling", "dynamic")),
            _interval(e.dynamic, factor, places),
            f"{e.amplification.q50[0]:.3f}",
            _interval(e.amplification, 1.0, 3),
            f"{e.front_m:.2f}",
        )
    yield table
    yield _codes(loads)
    if loads.frequency_hz.size:
        yield (
            f"The bridge: {loads.length_m:g} m, first frequencies "
            f"{', '.join(f'{f:.3g}' for f in loads.frequency_hz[:3])} Hz."
        )


def _codes(loads: BridgeLoads) -> TextTable:
    models = [c.model for c in loads.effects[0].codes] if loads.effects else []
    table = TextTable(
        "This vehicle over load models of codes (one lane, characteristic, with their dynamic allowance)",
        ("load effect", *models),
    )
    for e in loads.effects:
        table.add_row(e.title, *(over_code(e, c.value) for c in e.codes))
    return table


def over_code(effect: LoadEffect, code: float) -> str:
    """Dynamic load effect, median, over that of a code; a dash where the code has next to none."""
    return "-" if code * effect.static.q50[0] <= 0.0 else f"{effect.dynamic.q50[0] / code:.2f}"


def _interval(values: Quantiles, factor: float, places: int) -> str:
    low, high = values.q05, values.q95
    return "-" if low is None or high is None else f"{factor * low[0]:.{places}f} to {factor * high[0]:.{places}f}"
