"""Kinds that whoever works on the program does not look at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.made_trucks.draw import Campaign, log_uniform
from studies.made_trucks.kinds import Change, with_truck
from studies.made_trucks.truck import Array, OwnSprings


def _hinged_frame(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # First bending of frames 6 to 12 Hz.
    return with_truck(campaign, frame_hinge_hz=float(rng.uniform(6.5, 12.0)))


def _links(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    slope = rng.uniform(0.05, 0.15, campaign.truck.axles)
    return with_truck(campaign, link_slope=slope)


def _cams(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    return replace(campaign, contact="cams")


def _tight_guesses(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    sd = {
        "unsprung_mass": 0.15,
        "pitch_inertia": 0.40,
        "cg_height": 0.15,
        "hitch_height": 0.04,
        "axle_load": 0.010,
        "axle_load_scale": 0.006,
    }
    ratio = {name: float(rng.uniform(2.5, 4.0)) for name in sd} | {"axle_load_scale": 1.0}
    return replace(campaign, knowledge=replace(campaign.knowledge, sd=sd, ratio=ratio))


def _giving_bump(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # A rubber or wooden bump that lies lower under the wheel than under the scanner, or was scanned badly.
    factor = 1.0 - float(rng.uniform(0.04, 0.10)) * float(rng.choice([1.0, 1.0, -0.7]))
    whole = campaign.bump.driven

    def driven(station_m: Array, across_m: Array) -> Array:
        return np.asarray(factor * whole(station_m, across_m))

    return replace(campaign, bump=replace(campaign.bump, driven=driven))


def _fading(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # Oil warms from run to run: the runs' dampers lie between 1.15 and 0.85 times their mean; order of runs is random.
    spread = np.linspace(1.0, -1.0, 6) * float(rng.uniform(0.05, 0.15))
    scales = 1.0 + spread - spread.mean()
    return replace(campaign, damper_scales=tuple(float(s) for s in rng.permutation(scales)))


def _lash(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # Worn eyes: 0.5 to 3 mm of free travel.
    return with_truck(campaign, lash_m=float(log_uniform(rng, 5e-4, 3e-3)))


def _rocker_and_bulk(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    # A load on its own springs, and a rocker with friction between the last two leaf springs.
    t = campaign.truck
    body = len(t.load_cases[0].body_mass_kg) - 1
    added = float(t.load_cases[1].body_mass_kg[body] - t.load_cases[0].body_mass_kg[body])
    at = float(t.cg_x_m(1)[body] + rng.uniform(-0.3, 0.3))
    height = float(t.load_cases[1].cg_height_m[body])
    bulk = OwnSprings(
        body,
        at,
        height,
        (1.0, float(rng.uniform(0.3, 0.6)) * added),
        float(rng.uniform(4.0, 9.0)),
        float(rng.uniform(0.05, 0.2)),
    )
    same = t.suspension[-1] == t.suspension[-2] == "leaf"
    return with_truck(campaign, own_springs=(bulk,), rocker_share=float(rng.uniform(0.2, 0.7)) if same else 0.0)


WITHHELD: dict[str, Change] = {
    "hinged frame": _hinged_frame,
    "wheels led aft": _links,
    "cam tires": _cams,
    "too tight guesses": _tight_guesses,
    "bump other than scanned": _giving_bump,
    "warming dampers": _fading,
    "worn damper eyes": _lash,
    "rocker and loose load": _rocker_and_bulk,
}
