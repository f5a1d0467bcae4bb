"""What the screen shows of load effects on a bridge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.display import TextTable

if TYPE_CHECKING:
    from sysid.prediction.bridge_effects import LoadEffect
    from sysid.prediction.predicted_passes import PassPrediction
    from sysid.prediction.quantiles import Quantiles
    from sysid.workflow.stage import Blocks

#: Units on the screen: factor from SI, unit and decimals.
_SHOWN = {"N m": (1e-3, "kN m", 1), "N": (1e-3, "kN", 1), "m": (1e3, "mm", 3), "": (1.0, "", 4)}


def shown_bridges(passes: Sequence[PassPrediction]) -> Blocks:
    """Load effects of passes over bridges; of several over one bridge each at the speed at which it is worst."""
    from sysid.results.worst_effects import worst_effects

    courses = dict.fromkeys((p.load_case, p.shape) for p in passes if p.bridge is not None)
    for case, shape in courses:
        over = [p for p in passes if p.bridge is not None and (p.load_case, p.shape) == (case, shape)]
        worst = worst_effects(over)
        yield _effects(over, list(worst.values()))
        yield _codes([e for _, e in worst.values()])
        one = over[0].bridge
        assert one is not None
        if one.frequency_hz.size:
            yield (
                f"The bridge: {one.length_m:g} m, first frequencies "
                f"{', '.join(f'{f:.3g}' for f in one.frequency_hz[:3])} Hz."
            )
        shown = {id(p): p for p, _ in worst.values()}
        yield from dict.fromkeys(warning for p in over if id(p) in shown for warning in p.warnings)
        if len(over) > 1:
            yield f"All load effects of these {len(over)} passes are in the tables below predictions/."


def _effects(over: Sequence[PassPrediction], worst: Sequence[tuple[PassPrediction, LoadEffect]]) -> TextTable:
    """At rest, with the motion of the vehicle, and with that of the bridge too."""
    speeds = sorted(3.6 * p.speed_m_s for p in over)
    several = len(over) > 1
    driven = f"{speeds[0]:.4g} to {speeds[-1]:.4g} km/h" if several else f"{speeds[0]:.4g} km/h"
    table = TextTable(
        f"{over[0].load_case}, {driven}, {over[0].shape}: largest load effects" + ", each at its worst speed" * several,
        ("load effect", "unit", "static", "rolling", "dynamic", "90 % interval", "amplification", "90 % interval",
         "at km/h" if several else "axle 1 at m"),
    )  # fmt: skip
    for p, e in worst:
        factor, unit, places = _SHOWN.get(e.unit, _SHOWN[""])
        table.add_row(
            e.title,
            unit,
            *(f"{factor * getattr(e, name).q50[0]:.{places}f}" for name in ("static", "rolling", "dynamic")),
            _interval(e.dynamic, factor, places),
            f"{e.amplification.q50[0]:.3f}",
            _interval(e.amplification, 1.0, 3),
            f"{3.6 * p.speed_m_s:.4g}" if several else f"{e.front_m:.2f}",
        )
    return table


def _codes(effects: Sequence[LoadEffect]) -> TextTable:
    models = [c.model for c in effects[0].codes] if effects else []
    table = TextTable(
        "This vehicle over load models of codes (one lane, characteristic, with their dynamic allowance)",
        ("load effect", *models),
    )
    for e in effects:
        table.add_row(e.title, *(over_code(e, c.value) for c in e.codes))
    return table


def over_code(effect: LoadEffect, code: float) -> str:
    """Dynamic load effect, median, over that of a code; a dash where the code has next to none."""
    return "-" if code * effect.static.q50[0] <= 0.0 else f"{effect.dynamic.q50[0] / code:.2f}"


def _interval(values: Quantiles, factor: float, places: int) -> str:
    low, high = values.q05, values.q95
    return "-" if low is None or high is None else f"{factor * low[0]:.{places}f} to {factor * high[0]:.{places}f}"
