"""What has to be said about a predicted pass: extrapolation, suspension travel, impulses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.campaign.requests import beyond_runs, pass_label
from sysid.prediction.trust import Extrapolation
from sysid.vehicle_model.passes import EDGES, EffectiveRoads, Pass

#: Departure of the mean load of the whole truck over a pass from its weight that is worth a sentence.
_IMPULSE = 0.01
#: Quantities of a pass that are compared with the driven runs: words, factor and unit for people.
_QUANTITIES = {
    "tire_deflection": ("tire deflection", 1e3, "mm"),
    "travel": ("suspension travel", 1e3, "mm"),
    "damper_speed": ("damper speed", 1.0, "m/s"),
}


def remarks(
    campaign: Campaign,
    request: PredictionRequest,
    trust: Sequence[Extrapolation],
    impulse: float,
    acting: Mapping[int, tuple[str, float]] | None = None,
) -> tuple[str, ...]:
    """Sentences about one pass.

    Parameters
    ----------
    trust : what of the pass goes beyond the driven runs. impulse : mean of all axle loads during the pass over the
    weight. acting : undeclared bump stops that act, by axle (index): direction and travel [m].
    """
    name = pass_label(campaign, request)
    sentences = [*beyond_runs(campaign, request), *_beyond(trust, name)]
    if acting:
        stops = ", ".join(f"axle {i + 1} in {way} at about {1e3 * m:.0f} mm" for i, (way, m) in sorted(acting.items()))
        sentences.append(
            f"{name}: bump stops act that are assumed, not declared: {stops}. Declare jounce_travel_m and "
            "rebound_travel_m if the travel is known."
        )
    if abs(impulse - 1.0) > _IMPULSE:
        sentences.append(
            f"{name}: averaged over the pass the axle loads sum to {impulse:.3f} times the weight; the truck is not "
            "at rest again at the end of the record."
        )
    return tuple(sentences)


def edges(campaign: Campaign, request: PredictionRequest, roads: EffectiveRoads) -> tuple[str, ...]:
    """A sentence about a bump whose edges are not followed well enough; none over smooth bumps."""
    misfit = roads.off_springs(Pass(request.load_case, request.bump))
    if misfit <= EDGES:
        return ()
    return (
        f"{pass_label(campaign, request)}: the bump has edges that a tire does not smooth as the model takes it; loads "
        f"over it may be off by {100.0 * misfit:.0f} % of the static load.",
    )


def _beyond(trust: Sequence[Extrapolation], name: str) -> list[str]:
    """One sentence per quantity that goes beyond the driven runs, the speed left out."""
    sentences = []
    for what, (words, factor, unit) in _QUANTITIES.items():
        of_axles = [e for e in trust if e.what == what]
        if of_axles:
            axles = ", ".join(
                f"axle {e.axle + 1} {factor * e.reached:.3g} {unit} (driven {factor * e.driven:.3g} {unit})"
                for e in of_axles
            )
            sentences.append(
                f"{name}: {words} goes beyond the driven runs: {axles}; the loads there are an extrapolation."
            )
    if lifted := [f"axle {e.axle + 1}" for e in trust if e.what == "lift_off"]:
        sentences.append(
            f"{name}: these wheels leave the road, which they never did in the driven runs: {', '.join(lifted)}."
        )
    return sentences
