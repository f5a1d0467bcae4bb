"""Effect of neighbouring axles and pitch on single-axle estimates of drops, and which estimates cannot be used alone.

A single-axle method treats the strongest mode of the whole vehicle in the record as if the axle were alone under its
share of the body. The size of this error follows from the modes of the vehicle, and from the full model's estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import Campaign, PlankDrop
from sysid.errors import SysidError
from sysid.estimation.parameters.campaign_parameters import (
    GENERIC_DAMPING,
    GENERIC_STIFFNESS,
    best_drop_estimates,
)
from sysid.estimation.parameters.rockers import shares_before_data
from sysid.sdof.analysis import axle_on_tire
from sysid.sdof.drop_results import NOT_ALONE, DropEstimate, DropMethod, DropSummary
from sysid.sdof.equations import corrected_damping, corrected_stiffness, paper_damping, paper_stiffness
from sysid.sdof.settings import DropSettings
from sysid.vehicle_model.ring_down_modes import RingDownModes, modes_after_drop, modes_after_release
from sysid.vehicle_model.vibration_modes import SmallMotion, small_motion

#: A mode counts from this strength on, relative to the strongest in the record.
SEEN = 0.2
#: Departures of stiffness and damping from which on an estimate must not be used alone.
FAR = (0.10, 0.25)


@dataclass(frozen=True)
class _Coupling:
    """For the drops of one axle: number of modes, and ratio of each method's value to the true one (k, c)."""

    modes: int
    expected: Mapping[DropMethod, tuple[float, float]]


def with_cautions(campaign: Campaign, drops: DropSummary) -> DropSummary:
    """The drop analysis with every single-axle estimate that must not be used alone marked, its error widened.

    An estimate is marked if its record shows several modes of the vehicle (strength above a fifth of the strongest). It
    is also marked if it departs from the full model's estimate by more than a tenth (k) or a quarter (c), beyond two
    of its own standard deviations. And it is marked if the modes of the vehicle alone lead to such a departure from the
    values with which they are computed. The standard deviations include the departure if the estimate is marked or the
    departure is beyond two of them, and in any case the departure to which the modes lead.
    """
    if len(campaign.vehicle.axles) == 1 and len(campaign.vehicle.bodies) == 1:
        return drops
    couplings = _couplings(campaign, drops)
    model = {(e.axle, e.load_case): e for e in drops.pooled if e.method == "model" and e.usable}

    def marked(e: DropEstimate) -> DropEstimate:
        key = (e.axle, e.load_case)
        if e.method == "model" or not e.usable or key not in couplings:
            return e
        return _marked(e, couplings[key], model.get(key))

    files = tuple(replace(a, estimates=tuple(marked(e) for e in a.estimates)) for a in drops.files)
    pooled = tuple(marked(e) for e in drops.pooled)
    return replace(drops, files=files, pooled=pooled, messages=(*_said(campaign, pooled, model), *drops.messages))


def _couplings(campaign: Campaign, drops: DropSummary) -> dict[tuple[int, str], _Coupling]:
    vehicle = campaign.vehicle
    couplings = {}
    by_case: dict[str, tuple[SmallMotion, np.ndarray, np.ndarray]] = {}
    for drop in campaign.plank_drops:
        key = (drop.axle, drop.load_case)
        if not drop.dampers or key in couplings or vehicle.suspension_axle[drop.axle] != drop.axle:
            continue
        try:
            if drop.load_case not in by_case:
                by_case[drop.load_case] = _small_motion(campaign, drops, drop.load_case)
            couplings[key] = _coupling(campaign, drop, *by_case[drop.load_case])
        except (SysidError, np.linalg.LinAlgError):
            # With these estimates the vehicle is unstable and has no useful modes: the single-axle estimates stay as
            # they are.
            continue
    return couplings


def _small_motion(campaign: Campaign, drops: DropSummary, load_case: str) -> tuple[SmallMotion, np.ndarray, np.ndarray]:
    """Small motions in one load case with the best estimates of the drops, generic values where there are none."""
    vehicle = campaign.vehicle
    best = best_drop_estimates(drops, load_case)
    on = [[j for j, owner in enumerate(vehicle.suspension_axle) if owner == i] for i in range(len(vehicle.axles))]

    def values(quantity: str) -> np.ndarray:
        best_values = []
        for i, axle in enumerate(vehicle.axles):
            generic = GENERIC_STIFFNESS[axle.suspension][0] if quantity == "stiffness" else GENERIC_DAMPING[0]
            if i in best and best[i].method == "model":
                best_values.append(float(getattr(best[i], quantity)))
            else:
                best_values.append(sum(float(getattr(best[j], quantity)) if j in best else generic for j in on[i]))
        return np.maximum(best_values, 1e-3)

    stiffness, damping = values("stiffness"), values("damping")
    tires = (
        np.array([a.tire_stiffness_N_per_m for a in vehicle.axles]),
        np.array([a.tire_damping_N_s_per_m for a in vehicle.axles]),
    )
    shares, first = shares_before_data(vehicle), next(iter(campaign.load_cases.values()))
    case = campaign.load_cases[load_case]
    return (
        small_motion(vehicle, case, stiffness, damping, *tires, load_share=shares, first=first),
        stiffness,
        damping,
    )


def _coupling(
    campaign: Campaign, drop: PlankDrop, motion: SmallMotion, stiffness: np.ndarray, damping: np.ndarray
) -> _Coupling:
    searched = DropSettings().frequency_range_hz
    modes: RingDownModes = (
        modes_after_release(motion, drop.axle, drop.lifted or (drop.axle,), searched)
        if drop.release == "body"
        else modes_after_drop(motion, drop.axle, searched)
    )
    if modes.pole.size == 0:
        return _Coupling(0, {})
    period = 2.0 * np.pi / modes.pole[0].imag
    decrement = -modes.pole[0].real * period
    axle = axle_on_tire(drop.axle, campaign.vehicle, campaign.load_cases[drop.load_case])
    given = (axle.mass, axle.unsprung_mass, axle.tire_stiffness, axle.tire_damping)
    truth = np.array([stiffness[drop.axle], damping[drop.axle]])
    paper = np.array([paper_stiffness(period, axle.mass), paper_damping(period, decrement, axle.mass)]) / truth
    exact = np.array([corrected_stiffness(period, decrement, *given), corrected_damping(period, decrement, *given)])
    exact = np.where(exact > 0.0, exact, np.nan) / truth
    methods: dict[DropMethod, np.ndarray] = {"paper": paper, "corrected": exact, "free_decay": exact}
    return _Coupling(int(np.sum(modes.strength >= SEEN)), {m: (float(r[0]), float(r[1])) for m, r in methods.items()})


def _marked(e: DropEstimate, coupling: _Coupling, model: DropEstimate | None) -> DropEstimate:
    """The estimate with standard deviations that include the departure, and a note if it must not be used alone."""
    value, sd = np.array([e.stiffness, e.damping]), np.array([e.stiffness_sd, e.damping_sd])
    expected = np.array(coupling.expected.get(e.method, (1.0, 1.0)))
    expected = np.where(np.isfinite(expected), expected, 1.0)
    if model is None:
        reference, error, against = value / expected, 0.0 * sd, "by the modes of the vehicle"
    else:
        reference, error = np.array([[model.stiffness, model.damping], [model.stiffness_sd, model.damping_sd]])
        against = "against the full model"
    off = value / reference - 1.0
    # Errors of the model do not count here: one that knows little does not make the estimate right.
    beyond = np.abs(value - reference) > 2.0 * sd
    wider = np.hypot(sd, np.maximum(np.where(beyond, np.abs(value - reference), 0.0), np.abs(value / expected - value)))
    note = e.note
    if coupling.modes > 1 or np.any((beyond & (np.abs(off) > FAR)) | (np.abs(expected - 1.0) > FAR)):
        # The departure is known no better than what it is taken from.
        wider = np.sqrt(sd**2 + (value - reference) ** 2 + error**2)
        modes = f"{coupling.modes} modes in this record, " if coupling.modes > 1 else ""
        said = f"{NOT_ALONE}: {modes}k {100.0 * off[0]:+.0f} % and c {100.0 * off[1]:+.0f} % {against}"
        note = "; ".join(part for part in (said, note) if part)
    return replace(e, stiffness_sd=float(wider[0]), damping_sd=float(wider[1]), note=note)


def _said(
    campaign: Campaign, pooled: tuple[DropEstimate, ...], model: Mapping[tuple[int, str], DropEstimate]
) -> tuple[str, ...]:
    """The rows to read first, and the axles whose single-axle rows must not be used alone."""
    axles = campaign.vehicle.axles
    marked = dict.fromkeys((e.axle, e.load_case) for e in pooled if e.caution.startswith(NOT_ALONE))
    if not marked:
        return ()
    names = ", ".join(f"'{axles[axle].name}'" for axle in sorted({axle for axle, _ in marked}))
    remedy = (
        "read the rows of method model, which fit all drops with the whole vehicle"
        if set(marked) <= set(model)
        else "the remedy is the fit of the drops or of bump runs by the full model"
    )
    return (
        f"The single-axle estimates (paper, corrected, free_decay) of {names} are not usable alone: neighbouring axles "
        f"and pitch move along. Their standard deviations allow for it; {remedy}.",
    )
