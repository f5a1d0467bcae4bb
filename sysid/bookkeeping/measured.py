"""What the logs say of declared numbers of axles: tire stiffness, travels, and priors of stiffness and damping."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from sysid.bookkeeping.drops import compressed_share
from sysid.bookkeeping.elimination import Derived
from sysid.bookkeeping.force_balance import Balance, RunSpectra
from sysid.bookkeeping.masses import stiffness_of
from sysid.bookkeeping.usual import of_axle, of_drop, of_tire
from sysid.campaign.records import BumpRun, Campaign, PlankDrop
from sysid.campaign.vehicle_records import Axle, Vehicle
from sysid.wording import shorten

#: Tire stiffness from wheel hop over the declared one: 0.8 to 1.15 on simulated trucks with the true one, which data
#: books give within some 20 %; with an unknown suspension, whose stiffness is 0.05 to 0.7 of the tires', to be added.
#: A single axle, which also moves with the frame, may be off by a further factor.
TIRES, TIRES_AND_SPRING, ONE_AXLE = (1.0 / 1.7, 1.7), (1.0 / 1.5, 2.4), 1.5
#: Largest travel over the declared free one: stops give way by 20 to 40 mm (1.2 on simulated trucks).
BEYOND_STOPS = (0.0, 1.7)
#: Balances that leave more than this unexplained tell no stiffness.
UNCLEAR = 0.2
#: Heights of planks that differ by this factor, for suspensions that are compressed by this much [m]; shares of one
#: axle repeat within a few per cent.
DIFFERENT, CLEAR_M, PLANKS = 1.3, 0.006, (0.75, 1.0 / 0.75)
#: Logarithm of a prior's median over what the balance of the frames says: at least this, or three of its own sd.
PRIOR_OFF, DAMPING_OFF, SURE = 0.7, 1.4, 3.0
#: Tires are at least this share of tires and suspension.
_LEAST_TIRE = 0.3
#: Share of the record before the bump that shows rest.
_REST_SHARE = 0.1


def measured_values(campaign: Campaign, hop_hz: Mapping[int, float], spectra: Sequence[RunSpectra]) -> list[Derived]:
    """Values that logs and declared numbers give together.

    Parameters
    ----------
    campaign
        After the quality check.
    hop_hz
        Frequencies of wheel hop by axle.
    spectra
        Of the runs, for the stiffnesses of the suspensions; there may be none.
    """
    balances = {name: b for name in campaign.load_cases if (b := _clear(stiffness_of(spectra, campaign, name)))}
    found: list[Derived] = []
    tires: list[Derived] = []
    for i, axle in enumerate(campaign.vehicle.axles):
        stiffness = [float(b.stiffness[i]) for b in balances.values()]
        if i in hop_hz:
            tires.append(_tire(campaign.vehicle, i, hop_hz[i], float(np.mean(stiffness)) if stiffness else None))
        found += _travels(campaign.bump_runs, i, axle)
        found += _planks(campaign.plank_drops, i)
        found += _priors(axle, stiffness, [float(b.damping[i]) for b in balances.values()])
    return [*found, *_judged(tires)]


def _clear(found: Balance | None) -> Balance | None:
    return found if found is not None and found.unexplained < UNCLEAR and np.all(found.stiffness > 0.0) else None


def _tire(vehicle: Vehicle, i: int, hop_hz: float, spring: float | None) -> Derived:
    """The hop frequency f after the bump gives kt = (2 pi f)^2 m_u - k."""
    axle, mass = vehicle.axles[i], vehicle.unsprung_mass_kg[i]
    both = (2.0 * math.pi * hop_hz) ** 2 * mass
    ratio = max(both - (spring or 0.0), _LEAST_TIRE * both) / axle.tire_stiffness_N_per_m
    powers = {**of_tire(axle, -1.0), of_axle("unsprung_mass_kg", axle, mass): 1.0}
    what = (
        f"the wheels of '{shorten(axle.name)}' hop at {hop_hz:.1f} Hz as on tires whose stiffness over the declared is"
    )
    return Derived(what, ratio, *(TIRES if spring is not None else TIRES_AND_SPRING), "", powers)


def _judged(tires: Sequence[Derived]) -> list[Derived]:
    """The values of all axles, with wider ranges where their geometric mean, in which scatter counts less, is usual."""
    if len(tires) > 1:
        mean = math.exp(sum(math.log(d.value) for d in tires) / len(tires))
        if not tires[0].low <= mean <= tires[0].high:
            return list(tires)
    return [replace(d, low=d.low / ONE_AXLE, high=d.high * ONE_AXLE) for d in tires]


def _travels(runs: Sequence[BumpRun], i: int, axle: Axle) -> Iterator[Derived]:
    """Largest compression and extension of all runs over the free travels."""
    for key, sign, travel in (
        ("jounce_travel_m", -1.0, axle.jounce_travel_m),
        ("rebound_travel_m", 1.0, axle.rebound_travel_m),
    ):
        peaks = [p for run in runs if (p := _peak(run, i, sign)) is not None]
        if travel is not None and peaks:
            what = f"the suspension of '{shorten(axle.name)}' moves in the logs, over its free travel, by"
            yield Derived(what, max(*peaks, 1e-6) / travel, *BEYOND_STOPS, "", {of_axle(key, axle, travel): -1.0})


def _peak(run: BumpRun, axle: int, sign: float) -> float | None:
    """Largest deflection from rest in one direction [m]."""
    for channel in run.log.channels:
        if channel.sensor.kind == "suspension_deflection" and channel.sensor.axle == axle:
            value = channel.value[np.isfinite(channel.value)]
            if value.size > 20:
                rest = float(np.median(value[: max(5, int(_REST_SHARE * value.size))]))
                # Single readings may be spikes.
                return float(np.quantile(sign * (value - rest), 1.0 - 3.0 / value.size))
    return None


def _planks(drops: Sequence[PlankDrop], axle: int) -> Iterator[Derived]:
    """One axle on planks of different height: its suspension is compressed by the same share of each."""
    shares = [
        (d, d.plank_height_m, share)
        for d in drops
        if d.axle == axle and d.plank_height_m is not None and (share := compressed_share(d)) is not None
    ]
    for (one, height, share), (other, second, other_share) in combinations(shares, 2):
        far = max(height, second) > DIFFERENT * min(height, second)
        if far and one.load_case == other.load_case and min(share * height, other_share * second) > CLEAR_M:
            powers = {of_drop(one.log.file, height): -1.0, of_drop(other.log.file, second): 1.0}
            files = f"{shorten(one.log.file, 100)} over that in {shorten(other.log.file, 100)}"
            what = f"the compression of the suspension as a share of the plank's height in {files} is"
            yield Derived(what, share / other_share, *PLANKS, "", powers)


def _priors(axle: Axle, stiffness: Sequence[float], damping: Sequence[float]) -> Iterator[Derived]:
    for quantity, found, least in (("stiffness", stiffness, PRIOR_OFF), ("damping", damping, DAMPING_OFF)):
        prior = axle.priors.get(quantity)
        positive = [v for v in found if v > 0.0]
        if prior is None or not positive:
            continue
        unit = "N_per_m" if quantity == "stiffness" else "N_s_per_m"
        number = of_axle(f"priors.{quantity}_{unit}", axle, prior.median)
        wide = math.exp(max(least, SURE * prior.log_sd))
        # One prior serves all load cases of an air spring: between them it is right.
        middle = min(max(prior.median, min(positive)), max(positive))
        what = f"the median of the prior of the {quantity} of '{shorten(axle.name)}', over that of the logs, is"
        yield Derived(what, prior.median / middle, 1.0 / wide, wide, "", {number: 1.0})
