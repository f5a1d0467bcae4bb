"""What a kind of trucks has beyond the ordinary one: functions of a campaign and a generator, returning a campaign."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from studies.made_trucks.draw import Campaign, log_uniform
from studies.made_trucks.motion import helper_stiffness
from studies.made_trucks.truck import Array, Truck

Change = Callable[[Campaign, np.random.Generator], Campaign]


def with_truck(campaign: Campaign, **changes: object) -> Campaign:
    """The campaign with another truck."""
    return replace(campaign, truck=replace(campaign.truck, **changes))  # type: ignore[arg-type]


def with_stiffness(truck: Truck, stiffness: list[Array]) -> Truck:
    """The truck with other stiffnesses per load case."""
    cases = tuple(replace(of, stiffness_n_per_m=k) for of, k in zip(truck.load_cases, stiffness, strict=True))
    return replace(truck, load_cases=cases)


def _ordinary(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    return campaign


def _bushings(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # Eye bushings of 3 to 10 kN/mm each, two dampers of two eyes: 3 to 20 MN/m an axle, assumption.
    return with_truck(campaign, bushing_n_per_m=log_uniform(rng, 2e6, 2e7, campaign.truck.axles))


def _leaf_hysteresis(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    t = campaign.truck
    leaf = np.array([s == "leaf" for s in t.suspension])
    # SAE 800905: loops of 5 to 12 % of the load, entered over millimetres; less friction in fast strokes.
    share = np.where(leaf, rng.uniform(0.05, 0.12) * rng.uniform(0.9, 1.1, t.axles), t.friction_share)
    return with_truck(
        campaign,
        friction_share=share,
        friction_stroke_m=float(rng.uniform(2e-3, 8e-3)),
        friction_rate_loss=float(rng.uniform(0.1, 0.5)),
        friction_rate_m_s=float(log_uniform(rng, 0.02, 0.2)),
    )


def _two_stages(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    t = campaign.truck
    if t.axles == 3:
        on = np.array([False, True, True])
    else:
        on = np.array([s == "leaf" for s in t.suspension])
        on[0] = False
    # Helpers of rigid trucks: rate times 2 to 3 beyond a knee between empty and laden (UMTRI: progressive packs).
    ratio = np.where(on, rng.uniform(0.8, 1.8), 0.0)
    first, last = t.spring_load_n(0), t.spring_load_n(1)
    knee = np.where(on, first + rng.uniform(0.15, 0.7) * (last - first), 1e9)
    main = np.where(on, log_uniform(rng, 5e5, 1.0e6), t.load_cases[0].stiffness_n_per_m)
    k = [
        np.where(on, helper_stiffness(load, knee, main, ratio), of.stiffness_n_per_m)
        for load, of in zip((first, last), t.load_cases, strict=True)
    ]
    suspension = tuple("leaf" if o else s for o, s in zip(on, t.suspension, strict=True))
    return replace(
        campaign, truck=replace(with_stiffness(t, k), helper_ratio=ratio, helper_knee_n=knee, suspension=suspension)
    )


def _saturating(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    t = campaign.truck
    # Blow-off valves: the secant halves at 0.4 to 2 m/s (Cebon; Gillespie: digressive dampers); c at 0.5 m/s as before.
    at = float(log_uniform(rng, 0.4, 2.0))
    grown = 1.0 + 0.5 / at
    return with_truck(
        campaign,
        damper_saturation_m_s=np.full(t.axles, at),
        damper_rebound_n_s_per_m=t.damper_rebound_n_s_per_m * grown,
        damper_jounce_n_s_per_m=t.damper_jounce_n_s_per_m * grown,
    )


def _gas(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    t = campaign.truck
    air = np.array([True] * t.axles)
    air[0] = False
    if t.axles == 6:
        air[3:] = [s == "air" for s in t.suspension[3:]]
    first, last = t.load_cases
    soft = log_uniform(rng, 2.4e5, 4.6e5) * rng.uniform(0.95, 1.05, t.axles)
    empty = np.where(air, soft, first.stiffness_n_per_m)
    ratio = t.spring_load_n(1) / t.spring_load_n(0)
    laden = np.where(air, empty * ratio ** float(rng.uniform(0.7, 0.95)), last.stiffness_n_per_m)
    suspension = tuple("air" if a else s for a, s in zip(air, t.suspension, strict=True))
    # Bellows 0.18 to 0.35 m of effective height: progressive in jounce (bellows catalogues, assumption of the range).
    height = np.where(air, rng.uniform(0.18, 0.35), np.inf)
    return replace(campaign, truck=replace(with_stiffness(t, [empty, laden]), suspension=suspension, bellows_m=height))


def _driven(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # A driver holds the speed within 0.3 to 1 s (assumption); drive torque pushes at the road, so that its couple about
    # the centre of gravity is the whole height (Gillespie, chapter 2).
    return with_truck(campaign, speed_hold_s=float(rng.uniform(0.3, 1.0)), speed_hold_height_m=0.0)


def _rolling(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # Springs 6 % apart, 2 to 4 degrees off square, sensors on one side.
    side = float(rng.choice([1.0, -1.0]))
    skew = float(np.deg2rad(rng.uniform(2.0, 4.0)) * rng.choice([1.0, -1.0]))
    changed = replace(
        campaign,
        bump=replace(campaign.bump, skew_rad=skew),
        measuring=replace(campaign.measuring, sides=(side,)),
    )
    share = 0.5 + 0.015 * float(rng.choice([1.0, -1.0]))
    return with_truck(changed, left_spring_share=share, left_load_share=0.5 + 0.5 * float(rng.uniform(-0.04, 0.04)))


OPEN: dict[str, Change] = {
    "ordinary": _ordinary,
    "dampers in rubber": _bushings,
    "leaf hysteresis": _leaf_hysteresis,
    "two-stage leaf springs": _two_stages,
    "saturating dampers": _saturating,
    "air springs": _gas,
    "driven by its wheels": _driven,
    "rolling truck": _rolling,
}
