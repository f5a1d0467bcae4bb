"""Predicted passes that would need bump stops which the model does not have, and what would give it some."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sysid.estimation.fit.law_choice import laws_of_axles
from sysid.estimation.parameters.suspension_elements import law_name
from sysid.export.contents import Results
from sysid.prediction.remarks import ARTEFACT_RATIO, BUMP_STOPS, has_bump_stops, knows_travel
from sysid.report.numbers import listing, speed

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction


def pass_name(p: PassPrediction) -> str:
    """Load case, speed and, where it is none of the scanned ones, bump of a pass."""
    return f"{p.load_case} {speed(p.speed_m_s)}\u00a0km/h" + (f" over {p.shape}" if p.shape else "")


def undeclared_travel(results: Results) -> list[int]:
    """Axles (indices) without `jounce_travel_m` or without `rebound_travel_m`."""
    return [i for i, axle in enumerate(results.campaign.vehicle.axles) if not knows_travel(axle)]


def artefact_passes(results: Results) -> list[str]:
    """Predicted passes whose peak ratio is too high for a truck with bump stops, on axles of unknown travel."""
    unknown = undeclared_travel(results)
    return [
        pass_name(p)
        for p in (() if results.predictions is None else results.predictions.passes)
        if any(math.isfinite(ratio := float(p.peak_ratio_q50[i])) and ratio >= ARTEFACT_RATIO for i in unknown)
    ]


def exceeded_travel(results: Results) -> dict[int, list[str]]:
    """Passes that predict more travel, upper end of its interval, than declared, by axle (index) without stops."""
    found: dict[int, list[str]] = {}
    for p in () if results.predictions is None else results.predictions.passes:
        for i, axle in enumerate(results.campaign.vehicle.axles):
            pairs = ((p.jounce_m, axle.jounce_travel_m), (p.rebound_m, axle.rebound_travel_m))
            beyond = any(
                travel is not None
                and declared is not None
                and float((travel.q50 if travel.q95 is None else travel.q95)[i]) > declared
                for travel, declared in pairs
            )
            if beyond and not has_bump_stops(axle):
                found.setdefault(i, []).append(pass_name(p))
    return found


def cautions(results: Results) -> list[str]:
    """Why wheel loads may not be those of the truck."""
    found = []
    if artefacts := artefact_passes(results):
        found.append(
            f"Peak wheel-load ratios of {ARTEFACT_RATIO:g} and more ({listing(artefacts)}) are artefacts: the model "
            "has no bump stops on axles whose jounce_travel_m and rebound_travel_m the campaign file does not declare."
        )
    if exceeded := exceeded_travel(results):
        where = [f"{name}, axle {i + 1}" for i, names in exceeded.items() for name in names]
        found.append(
            f"Predicted suspension travel is larger than declared ({listing(where)}): the wheel-load ratios there "
            f"leave out the stops, because the axle's law has no {BUMP_STOPS}."
        )
    return found


def remedies(results: Results) -> list[str]:
    """What to write into the campaign file before high wheel-load ratios are used."""
    if results.predictions is None:
        return []
    steps = []
    if unknown := undeclared_travel(results):
        every = len(unknown) == len(results.campaign.vehicle.axles)
        axles = "every axle" if every else listing([f"axle {i + 1}" for i in unknown])
        steps.append(
            f"Declare jounce_travel_m and rebound_travel_m of {axles} before using high wheel-load ratios: this report "
            f"then says where stops are reached. Only a suspension_law with {BUMP_STOPS} puts them into the model."
        )
    if exceeded := exceeded_travel(results):
        laws: dict[str, list[str]] = {}
        for i in exceeded:
            laws.setdefault(_law_with_stops(results, i), []).append(f"axle {i + 1}")
        steps += [
            f'Write suspension_law = "{law}" for {listing(axles)} into campaign.toml and run again: with its stops the '
            "model can say what happens beyond the declared travel."
            for law, axles in laws.items()
        ]
    return steps


def _law_with_stops(results: Results, axle: int) -> str:
    if results.fit is None:
        return BUMP_STOPS
    return law_name(laws_of_axles(results.campaign.vehicle, results.fit.laws)[axle] | {BUMP_STOPS})
