"""Draws of an ordinary truck, its bump and its measurement; every range with its source.

Sources: UMTRI = Fancher, Ervin, Winkler and Gillespie, A factbook of the mechanical properties of the components for
single-unit and articulated heavy trucks, UMTRI-86-12 (1986); Fancher = Fancher, Ervin, MacAdam and Winkler, SAE 800905;
Gillespie = Fundamentals of vehicle dynamics (1992); Cebon = Handbook of vehicle-road interaction (1999);
Zegelaar = The dynamic response of tyres to brake torque variations and road unevennesses (1998).
What has no source is an assumption.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.made_trucks.truck import Array, LoadCase, Truck

Surface = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Bump:
    """Height of the bump over its own station and the place across (left positive) [m]; `scanned` if that differs."""

    length_m: float
    driven: Surface
    scanned: Surface
    skew_rad: float = 0.0


@dataclass(frozen=True)
class Measuring:
    """Sensors, logger and scanner."""

    sample_s: float
    filter_type: str
    filter_order: int
    filter_cutoff_hz: float
    sides: tuple[float, ...]  # 1 left, -1 right
    places_m: tuple[float, float, float]  # from the middle: deflection, axle, frame
    noise: tuple[float, float, float]  # m, m/s^2, m/s^2, white
    drift: float  # slow noise over white noise
    gain_sd: float
    scan_noise_m: float
    scan_points: int
    lost: int = 0  # spans without readings
    axle_range_g: float = 10.0
    spikes: int = 0
    heading_error_deg: float = 0.0


@dataclass(frozen=True)
class Knowledge:
    """Real standard deviations of what is declared, and how many times too small the declared tolerance is."""

    sd: dict[str, float]
    ratio: dict[str, float]


@dataclass(frozen=True)
class Campaign:
    """Everything that is drawn."""

    truck: Truck
    bump: Bump
    measuring: Measuring
    knowledge: Knowledge
    roughness_m3: float  # G_d(n0) of ISO 8608
    drops: bool
    contact: str = "spokes"
    damper_scales: tuple[float, ...] = (1.0,) * 6  # of the six runs


def log_uniform(rng: np.random.Generator, low: float, high: float, size: int | None = None) -> Array:
    """Draws whose logarithm is uniform."""
    return np.asarray(np.exp(rng.uniform(np.log(low), np.log(high), size)))


def ordinary(rng: np.random.Generator, lowboy: bool) -> Campaign:
    """One campaign with no other effect than mild ones."""
    return Campaign(
        truck=_lowboy(rng) if lowboy else _three_axles(rng),
        bump=draw_bump(rng),
        measuring=_measuring(rng),
        knowledge=_knowledge(rng),
        # Smooth asphalt: ISO 8608 class A ends at 32e-6 m^3, new roads are below 4e-6 (Cebon); test tracks lie lower.
        roughness_m3=float(log_uniform(rng, 1e-7, 2e-6)),
        drops=bool(rng.random() < 0.5),
    )


def _knowledge(rng: np.random.Generator) -> Knowledge:
    # Weighed parts to lists of parts; sketches of the load; portable scales 0.5 to 1 %: assumptions from practice.
    ranges = {
        "unsprung_mass": (0.03, 0.12),
        "pitch_inertia": (0.12, 0.40),
        "cg_height": (0.04, 0.15),
        "hitch_height": (0.01, 0.03),
        "axle_load": (0.003, 0.01),
        "axle_load_scale": (0.003, 0.01),
    }
    sd = {name: float(log_uniform(rng, *bounds)) for name, bounds in ranges.items()}
    # Errors are 1 to 4 times what is declared, half of the time less than 1.4 times: assumption.
    return Knowledge(sd, {name: float(4.0 ** (rng.random() ** 2)) for name in ranges})


def _measuring(rng: np.random.Generator) -> Measuring:
    fast = rng.random() < 0.4
    sides = ((1.0,), (-1.0,), (1.0, -1.0), (1.0, -1.0))[rng.integers(4)]
    return Measuring(
        sample_s=0.002 if fast else 0.005,
        filter_type=("butterworth", "bessel")[rng.integers(2)],
        filter_order=int(rng.choice([2, 4, 4, 6])),
        # A fifth to two fifths of the sampling frequency: usual settings of loggers.
        filter_cutoff_hz=float(np.round(rng.uniform(60.0, 120.0) if fast else rng.uniform(35.0, 70.0))),
        sides=sides,
        # Beside the spring and on the frame rail, 0.86 m wide (SAE frame width 34 in).
        places_m=tuple(float(np.round(rng.uniform(*b), 2)) for b in ((0.40, 0.55), (0.5, 0.7), (0.38, 0.45))),  # type: ignore[arg-type]
        # Inductive and draw-wire sensors; piezoresistive accelerometers with the drive line running: assumption.
        noise=(
            float(log_uniform(rng, 1e-4, 4e-4)),
            float(log_uniform(rng, 0.1, 0.4)),
            float(log_uniform(rng, 0.06, 0.25)),
        ),
        drift=float(rng.uniform(0.2, 0.8)),
        gain_sd=float(rng.uniform(0.003, 0.010)),
        scan_noise_m=float(rng.uniform(0.001, 0.0025)),
        scan_points=int(rng.integers(25_000, 50_000)),
        lost=int(rng.random() < 0.25),
        axle_range_g=float(rng.choice([10.0, 10.0, 10.0, 6.0])),
        heading_error_deg=float(rng.normal(0.0, 0.2)),
    )


def draw_bump(rng: np.random.Generator, lowest_m: float = 0.3, longest_m: float = 4.0) -> Bump:
    """Humps 50 to 100 mm high and 0.3 to 4 m long: parking-lot bumps to Watts humps (ITE guidelines for humps)."""
    length = float(log_uniform(rng, lowest_m, longest_m))
    height = min(float(rng.uniform(0.05, 0.1)), 0.2 * length)
    shape = rng.integers(4)
    at = np.arange(-0.3, length + 0.3, 0.002)
    t = np.clip(at / length, 0.0, 1.0)
    if shape == 0:
        radius = (length**2 / 4.0 + height**2) / (2.0 * height)
        z = np.sqrt(radius**2 - (np.clip(at, 0.0, length) - length / 2.0) ** 2) - radius + height
    elif shape == 1:
        z = height / 2.0 * (1.0 - np.cos(2.0 * np.pi * t))
    elif shape == 2:
        ramp = float(rng.uniform(0.2, 0.4))
        z = height * np.clip(np.minimum(t, 1.0 - t) / ramp, 0.0, 1.0)
    else:
        # Worn: the crest is moved and the far flank sags.
        moved = t ** float(rng.uniform(0.7, 1.4))
        z = height * np.sin(np.pi * moved) ** float(rng.uniform(1.0, 2.0)) * (1.0 - 0.15 * np.sin(2.0 * np.pi * t))
    # Asphalt has rounded edges of some centimetres: assumption.
    width = float(rng.uniform(0.02, 0.05))
    kernel = np.hanning(round(width / 0.002) + 3)
    z = np.convolve(z, kernel / kernel.sum(), mode="same")
    z[[0, -1]] = 0.0

    def surface(station_m: Array, across_m: Array) -> Array:
        return np.asarray(np.interp(station_m, at, z))

    return Bump(length, surface, surface)


def _dampers(rng: np.random.Generator, c: Array) -> dict[str, Array]:
    """Half of the trucks have more rebound than jounce damping: 1.5 to 3 times is usual (Gillespie; Cebon)."""
    asymmetry = float(rng.uniform(1.3, 3.0)) if rng.random() < 0.5 else 1.0
    low = 2.0 * c / (1.0 + asymmetry)
    return {"damper_rebound_n_s_per_m": asymmetry * low, "damper_jounce_n_s_per_m": low}


def _three_axles(rng: np.random.Generator) -> Truck:
    spacing = float(rng.uniform(1.30, 1.40))  # tandem spacings, UMTRI
    x = np.array([0.0, 1.0, 1.0]) * float(rng.uniform(3.6, 5.2)) + np.array([0.0, 0.0, spacing])
    unsprung = np.array([rng.uniform(450, 650), *(rng.uniform(900, 1200, 2))])  # UMTRI: 540 steer, 1050 drive
    empty = np.array([rng.uniform(4200, 5800), *(rng.uniform(2300, 3400) * rng.uniform(0.94, 1.06, 2))])
    laden = np.array([empty[0] * rng.uniform(1.15, 1.5), *(rng.uniform(7000, 9500) * rng.uniform(0.96, 1.04, 2))])
    air = bool(rng.random() < 0.4)
    steer = log_uniform(rng, 3.0e5, 7.0e5)  # UMTRI: 840 to 2000 lb/in per spring
    # UMTRI: leaf tandems 3000 to 8000 lb/in per side and axle at most; soft ones of vocational trucks half of it.
    rear = log_uniform(rng, 2.6e5, 4.8e5) if air else log_uniform(rng, 6.0e5, 1.8e6)
    k = np.array([steer, *(rear * rng.uniform(0.95, 1.05, 2))])
    laden_k = k.copy()
    if air:
        # Pressure follows the load; atmosphere and walls leave a part: power 0.7 to 0.95 of the load.
        ratio = (laden[1:] - unsprung[1:]) / (empty[1:] - unsprung[1:])
        laden_k[1:] = k[1:] * ratio ** float(rng.uniform(0.7, 0.95))
    c = np.array([log_uniform(rng, 6e3, 1.6e4), *(log_uniform(rng, 1.0e4, 2.4e4) * rng.uniform(0.95, 1.05, 2))])
    cases = (
        _case("empty", rng, empty, unsprung, k, (0.95, 1.20), (1.6, 2.1)),
        _case("laden", rng, laden, unsprung, laden_k, (1.30, 1.80), (1.6, 2.1)),
    )
    return Truck(
        axle_x_m=np.round(x, 2),
        axle_body=(0, 0, 0),
        suspension=("leaf", *(("air", "air") if air else ("leaf", "leaf"))),
        load_cases=cases,
        **_running_gear(rng, 3, unsprung, c, air_from=1 if air else 3),
    )


def _lowboy(rng: np.random.Generator) -> Truck:
    first, spacing = float(rng.uniform(3.9, 4.6)), float(rng.uniform(1.30, 1.40))
    trailer = first + float(rng.uniform(8.5, 9.8)) + np.arange(3) * float(rng.uniform(1.27, 1.4))
    x = np.round(np.array([0.0, first, first + spacing, *trailer]), 2)
    unsprung = np.array([rng.uniform(450, 650), *rng.uniform(900, 1200, 2), *rng.uniform(650, 850, 3)])  # UMTRI
    tractor = float(rng.uniform(4600, 5600))  # sprung, UMTRI: 6x4 tractors
    empty = np.array(
        [rng.uniform(3700, 4400), *rng.uniform(2600, 3300, 2), *(rng.uniform(2900, 3700) * rng.uniform(0.93, 1.07, 3))]
    )
    laden = np.array(
        [
            rng.uniform(4600, 5400),
            *rng.uniform(8800, 10300, 2),
            *(rng.uniform(9000, 11500) * rng.uniform(0.97, 1.03, 3)),
        ]
    )
    k = np.array(
        [
            log_uniform(rng, 3.0e5, 7.0e5),
            *(log_uniform(rng, 2.6e5, 4.8e5) * rng.uniform(0.95, 1.05, 2)),
            *(log_uniform(rng, 9e5, 2.2e6) * rng.uniform(0.95, 1.05, 3)),  # UMTRI: trailer leaf springs
        ]
    )
    laden_k = k.copy()
    ratio = (laden[1:3] - unsprung[1:3]) / (empty[1:3] - unsprung[1:3])
    laden_k[1:3] = k[1:3] * ratio ** float(rng.uniform(0.7, 0.95))
    c = np.array(
        [
            log_uniform(rng, 6e3, 1.6e4),
            *(log_uniform(rng, 1.0e4, 2.4e4) * rng.uniform(0.95, 1.05, 2)),
            *(log_uniform(rng, 6e3, 2.4e4) * rng.uniform(0.95, 1.05, 3)),
        ]
    )
    cases = tuple(
        _case(name, rng, load, unsprung, stiffness, heights, radii, tractor)
        for name, load, stiffness, heights, radii in (
            ("empty", empty, k, (1.0, 1.2), (3.0, 3.9)),
            ("laden", laden, laden_k, (1.35, 1.8), (2.2, 3.2)),
        )
    )
    # The tractor does not change with the cargo.
    first_case = cases[0]
    cases[1].pitch_inertia_kg_m2[0] = first_case.pitch_inertia_kg_m2[0]
    cases[1].roll_inertia_kg_m2[0] = first_case.roll_inertia_kg_m2[0]
    cases[1].cg_height_m[0] = first_case.cg_height_m[0]
    return Truck(
        axle_x_m=x,
        axle_body=(0, 0, 0, 1, 1, 1),
        suspension=("leaf", "air", "air", "leaf", "leaf", "leaf"),
        load_cases=cases,
        hitch_x_m=round(first + spacing / 2.0 - float(rng.uniform(0.15, 0.4)), 2),
        hitch_height_m=round(float(rng.uniform(1.1, 1.3)), 2),
        **_running_gear(rng, 6, unsprung, c, air_from=1, air_to=3),
    )


def _case(
    name: str,
    rng: np.random.Generator,
    load_kg: Array,
    unsprung_kg: Array,
    stiffness: Array,
    heights: tuple[float, float],
    gyration_m: tuple[float, float],
    tractor_kg: float | None = None,
) -> LoadCase:
    """Radii of gyration in pitch about those that UMTRI's inertias give; in roll 0.6 to 0.8 m."""
    sprung = float(np.sum(load_kg - unsprung_kg))
    if tractor_kg is None:
        mass, height, radius = (
            np.array([sprung]),
            np.array([rng.uniform(*heights)]),
            np.array([rng.uniform(*gyration_m)]),
        )
    else:
        mass = np.array([tractor_kg, sprung - tractor_kg])
        height = np.array([rng.uniform(1.0, 1.15), rng.uniform(*heights)])
        radius = np.array([rng.uniform(1.75, 2.0), rng.uniform(*gyration_m)])
    roll = mass * rng.uniform(0.6, 0.8) ** 2
    return LoadCase(name, load_kg, mass, mass * radius**2, roll, height, stiffness)


def _running_gear(
    rng: np.random.Generator, axles: int, unsprung: Array, c: Array, *, air_from: int, air_to: int | None = None
) -> dict[str, Any]:
    single = np.arange(axles) == 0
    leaf = np.full(axles, True)
    leaf[air_from:air_to] = False
    stiffness = np.where(
        single, rng.uniform(1.45e6, 2.0e6), rng.uniform(2.5e6, 3.5e6)
    )  # UMTRI: 4000 to 5500 lb/in each
    # Half of the trucks rub mildly: leaf packs 2 to 3 % of the load, air springs (torque rods, dampers) less than 1 %.
    mild = float(rng.random() < 0.5)
    friction = mild * np.where(leaf, rng.uniform(0.005, 0.03), rng.uniform(0.0, 0.01))
    return {
        "unsprung_kg": unsprung,
        "axle_roll_inertia_kg_m2": np.where(single, rng.uniform(300, 450), rng.uniform(420, 560)),  # UMTRI
        "track_m": np.where(single, 2.03, 1.83),  # UMTRI: 80 and 72 in
        "spring_track_m": np.where(single, 0.82, 0.97),  # UMTRI: 32 and 38 in
        "damper_track_m": np.full(axles, 0.95),
        # UMTRI: composite less spring roll stiffness spans 10 to 100 thousand in lb/deg.
        "auxiliary_roll_n_m": np.where(single, rng.uniform(3e4, 1e5), rng.uniform(1.5e5, 6e5)),
        "radius_m": round(float(rng.uniform(0.49, 0.52)), 3),
        # Radial truck tires are nearly straight about the rated load and softer at small loads (UMTRI): assumption.
        "tire_exponent": float(rng.uniform(1.03, 1.20)),
        "tire_stiffness_n_per_m": stiffness * rng.uniform(0.97, 1.03, axles),
        # About 0.05 to 0.15 % of the stiffness times a second: Zegelaar; Cebon.
        "tire_damping_n_s_per_m": stiffness * float(rng.uniform(6e-4, 1.5e-3)),
        **_dampers(rng, c),
        "left_spring_share": 0.5 + 0.5 * float(np.clip(rng.normal(0.0, 0.015), -0.03, 0.03)),
        "left_load_share": 0.5 + 0.5 * float(np.clip(rng.normal(0.0, 0.01), -0.03, 0.03)),
        "friction_share": friction,
        "friction_stroke_m": float(log_uniform(rng, 1e-3, 3e-3)),  # Fancher: beta of leaf springs, 0.08 in
        # Travels of truck suspensions between stops, 150 to 200 mm together: assumption.
        "jounce_m": rng.uniform(0.075, 0.11) * np.ones(axles),
        "rebound_m": rng.uniform(0.085, 0.12) * np.ones(axles),
        "stop_n_per_m": float(log_uniform(rng, 8e5, 4e6)),  # rubber stops: assumption
        # Speed held stiffly without any couple, as `servo` of the campaign file: the force of wheels is a kind.
        "speed_hold_s": 0.05,
    }
