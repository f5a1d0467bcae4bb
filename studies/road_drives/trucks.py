"""Rigid trucks on random roads: drawn, driven by Runge-Kutta, and measured, apart from the code of the product.

One rigid body (heave z, pitch th, nose up) on axles that slide along its vertical axis, tires that only push, Dahl
friction, dampers c v g / (1 + |v| / v_s), air springs k q (1 + a q / 2 + b q^2 / 3), the road of ISO 8608 by
independent normal amplitudes, the same for all axles one after the other. Ranges: k, c, masses and friction from
P. S. Fancher et al., A Factbook of the Mechanical Properties of the Components for Single-Unit and Articulated Heavy
Trucks, UMTRI-86-12 (1986), rounded; sensors as sold for trucks (an assumption).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from sysid.campaign.records import Acquisition, Campaign, Channel, Log, RoadDrive, Sensor
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle

STEP_S, SAMPLE_S, SECONDS, G = 1e-3, 5e-3, 42.0, 9.81
RADIUS_M, SETTLING_S = 0.5, 2.0
#: ISO 8608, geometric means [m3] at 0.1 cycles/m.
CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6}


@dataclass(frozen=True)
class Truth:
    """A truck as it is, arrays by axle in SI; `declared_*` is what its campaign says."""

    x: np.ndarray
    k: np.ndarray
    c: np.ndarray
    unsprung: np.ndarray
    tire_k: np.ndarray
    tire_c: np.ndarray
    load_kg: np.ndarray
    friction: np.ndarray
    slip_m: float
    ratio: np.ndarray
    knee: np.ndarray
    slope: np.ndarray
    curve: np.ndarray
    inertia: float
    height: float
    air: np.ndarray

    @property
    def secant(self) -> np.ndarray:
        """c as it is reported: the mean of both directions at 0.5 m/s."""
        return np.asarray(self.c / (1.0 + 0.5 / self.knee))


def draw(rng: np.random.Generator, rear: int | None = None) -> Truth:
    """One truck with two or three rear axles, or with `rear` of them."""
    rear = int(rng.integers(2, 4)) if rear is None else rear
    n = 1 + rear
    x = np.concatenate([[0.0], rng.uniform(3.4, 5.2) + 1.32 * np.arange(rear)])
    air = np.concatenate([[False], np.full(rear, rng.random() < 0.5)])
    load = np.concatenate([[rng.uniform(4500, 7000)], rng.uniform(4000, 9500) * rng.uniform(0.93, 1.07, rear)])
    unsprung = np.concatenate([[rng.uniform(450, 650)], np.full(rear, rng.uniform(700, 1100))])
    carried = (load - unsprung) * G
    k = np.where(air, carried / rng.uniform(0.10, 0.20, n), carried / rng.uniform(0.04, 0.10, n))
    body = float(load.sum() - unsprung.sum())
    span = x[-1] + 2.0
    return Truth(
        x=x, k=k, c=rng.uniform(7e3, 2e4, n), unsprung=unsprung,
        tire_k=np.concatenate([[rng.uniform(1.5e6, 2e6)], rng.uniform(2.5e6, 3.6e6, rear)]),
        tire_c=rng.uniform(1.5e3, 4e3, n), load_kg=load,
        friction=np.where(air, rng.uniform(0.0, 0.01), rng.uniform(0.01, 0.07)) * np.ones(n),
        slip_m=float(rng.uniform(0.8e-3, 2.5e-3)), ratio=rng.uniform(1.0, 2.5, n), knee=rng.uniform(0.7, 4.0, n),
        slope=np.where(air, -rng.uniform(1.0, 3.0), 0.0), curve=np.where(air, rng.uniform(0.0, 40.0), 0.0),
        inertia=body * (0.3 * span) ** 2, height=float(rng.uniform(1.0, 1.6)), air=air,
    )  # fmt: skip


def road(rng: np.random.Generator, roughness: float, length_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Stations [m] every 5 cm and heights [m] with the one-sided spectrum G (0.1 / n)^2 from 0.02 to 3 cycles/m."""
    count = int(length_m / 0.05)
    n = np.fft.rfftfreq(count, 0.05)
    density = np.where((n >= 0.02) & (n <= 3.0), roughness * (0.1 / np.maximum(n, 1e-9)) ** 2, 0.0)
    amplitude = 0.5 * count * np.sqrt(density * n[1])
    spectrum = amplitude * (rng.normal(size=n.size) + 1j * rng.normal(size=n.size))
    return 0.05 * np.arange(count), np.fft.irfft(spectrum, count)


@dataclass(frozen=True)
class Motion:
    """Deflections (steps, n) [m], heave and pitch accelerations (steps,), and of axles (steps, n), loads [N]."""

    deflection: np.ndarray
    heave: np.ndarray
    pitch: np.ndarray
    axle: np.ndarray
    load: np.ndarray


def drive(
    trucks: Sequence[Truth], speeds: Sequence[float], roughness: Sequence[float], rngs: Sequence[np.random.Generator]
) -> list[Motion]:
    """Motion every 1 ms of trucks with as many axles each, side by side, one drive of 42 s each."""
    b, n, steps = len(trucks), trucks[0].x.size, int(SECONDS / STEP_S)

    def of(name: str) -> np.ndarray:
        return np.array([getattr(t, name) for t in trucks])

    x, k, c, unsprung, tire_k, tire_c = (of(m) for m in ("x", "k", "c", "unsprung", "tire_k", "tire_c"))
    ratio, knee, slope_a, curve, height = (of(m) for m in ("ratio", "knee", "slope", "curve", "height"))
    slip, static, v = of("slip_m")[:, None], of("load_kg") * G, np.array(speeds)[:, None]
    times = STEP_S / 2 * np.arange(2 * steps + 2)
    begin = np.clip(times / SETTLING_S, 0.0, 1.0)[:, None]
    ground, incline = np.zeros((2, times.size, b, n))
    for j in range(b):
        station, heights = road(rngs[j], roughness[j], SECONDS * speeds[j] + 60.0)
        at = 40.0 + speeds[j] * times[:, None] - x[j]
        ground[:, j] = begin * np.interp(at, station, heights)
        incline[:, j] = begin * np.interp(at, station, np.gradient(heights, station))
    carried = static - unsprung * G
    mass = carried.sum(axis=1) / G
    arm, lever = x - np.sum(carried * x, axis=1, keepdims=True) / carried.sum(axis=1, keepdims=True), height - RADIUS_M
    # Wheels follow the pitch of the body along the road, and the loads tilt with it.
    inertia, tilt = of("inertia") + unsprung.sum(axis=1) * lever**2, -lever * carried.sum(axis=1)
    rubbing = of("friction") * carried

    def stretch(u: np.ndarray) -> np.ndarray:
        return np.asarray(u[:, :1] - u[:, 1:2] * arm - u[:, 2:])

    def push(y: np.ndarray, h: np.ndarray, s: np.ndarray) -> np.ndarray:
        return np.asarray(np.maximum(tire_k * (h - y[:, 2 : 2 + n]) + tire_c * (v * s - y[:, 4 + n :]), -static))

    def rates(y: np.ndarray, phi: np.ndarray, h: np.ndarray, s: np.ndarray) -> np.ndarray:
        u, rate = y[:, : 2 + n], y[:, 2 + n :]
        q, qd = stretch(u), stretch(rate)
        damper = c * qd / (1.0 + np.abs(qd) / knee) * np.where(qd > 0.0, 2.0 * ratio, 2.0) / (1.0 + ratio)
        pull = k * q * (1.0 + slope_a * q / 2.0 + curve * q**2 / 3.0) + damper + rubbing * phi
        tire = push(y, h, s)
        along = -(static + tire) * s
        turn = (np.sum(pull * arm, axis=1) + lever * along.sum(axis=1) - tilt * u[:, 1]) / inertia
        up = -pull.sum(axis=1) / mass
        return np.concatenate([rate, up[:, None], turn[:, None], (tire + pull) / unsprung], axis=1)

    y, phi, out = np.zeros((b, 4 + 2 * n)), np.zeros((b, n)), np.zeros((steps, b, 2 + 3 * n))
    for i in range(steps):
        h, s = ground[2 * i : 2 * i + 3], incline[2 * i : 2 * i + 3]
        q = stretch(y[:, : 2 + n])
        k1 = rates(y, phi, h[0], s[0])
        out[i] = np.concatenate([q, k1[:, 2 + n :], push(y, h[0], s[0])], axis=1)
        k2 = rates(y + STEP_S / 2 * k1, phi, h[1], s[1])
        k3 = rates(y + STEP_S / 2 * k2, phi, h[1], s[1])
        k4 = rates(y + STEP_S * k3, phi, h[2], s[2])
        y = y + STEP_S / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        moved = stretch(y[:, : 2 + n]) - q
        phi = np.sign(moved) + (phi - np.sign(moved)) * np.exp(-np.abs(moved) / slip)
    return [
        Motion(o[:, :n], o[:, n], o[:, n + 1], o[:, n + 2 : 2 + 2 * n], o[:, 2 + 2 * n :]) for o in out.swapaxes(0, 1)
    ]


def campaign(
    truck: Truth,
    drives: Sequence[tuple[float, Motion]],
    rng: np.random.Generator,
    noise: float = 1.0,
    exact: bool = False,
) -> Campaign:
    """What a test engineer knows of a truck that is driven at speeds [m/s].

    `noise` is the sensors' over the usual one; `exact`: no gains, and everything declared exactly.
    """

    def off(sd: float, size: int | None = None) -> np.ndarray:
        return np.exp((0.0 if exact else sd) * rng.normal(size=size))

    n = truck.x.size
    centre = float((truck.load_kg - truck.unsprung) @ truck.x / (truck.load_kg - truck.unsprung).sum())
    scale = off(0.005)
    loads = truck.load_kg * scale * off(0.005, n)
    unsprung = truck.unsprung * off(0.03, n)
    tires = truck.tire_k * off(0.05, n)
    axles = tuple(
        Axle(f"axle {i + 1}", 0, float(truck.x[i]), float(unsprung[i]), float(tires[i]), 2.5e3, RADIUS_M,
             "air" if truck.air[i] else "leaf", load_dependent=bool(truck.air[i])) for i in range(n)
    )  # fmt: skip
    case = LoadCase(
        "only", tuple(loads.tolist()), (float(loads.sum() - unsprung.sum()),),
        (float(truck.inertia * off(0.05)),), (float(truck.height * off(0.03)),),
    )  # fmt: skip
    gains = {kind: off(sd, n) for kind, sd in (("q", 0.005), ("axle", 0.01), ("frame", 0.01))}
    sd = {"q": 3e-4, "axle": 0.2, "frame": 0.15}
    low_pass = signal.butter(4, 60.0, fs=1.0 / STEP_S)
    runs = []
    for number, (speed, motion) in enumerate(drives):
        frame = motion.heave[:, None] - motion.pitch[:, None] * (truck.x - centre)
        channels = []
        for kind, values in (("q", motion.deflection), ("axle", motion.axle), ("frame", frame)):
            shown = signal.lfilter(*low_pass, values, axis=0)[int(SETTLING_S / STEP_S) :: int(SAMPLE_S / STEP_S)]
            shown = shown * gains[kind] + noise * sd[kind] * rng.normal(size=shown.shape)
            for i in range(n):
                sensor = {
                    "q": Sensor(f"q{i}", "suspension_deflection", "m", axle=i),
                    "axle": Sensor(f"a{i}", "axle_acceleration", "m/s^2", axle=i),
                    "frame": Sensor(f"b{i}", "body_acceleration", "m/s^2", body=0, x_m=float(truck.x[i])),
                }[kind]
                time = SAMPLE_S * np.arange(shown.shape[0])
                channels.append(Channel(sensor, time, shown[:, i], np.zeros(time.size, np.int8)))
        told = speed * (1.0 if exact else rng.uniform(0.985, 1.015))
        runs.append(RoadDrive("only", told, Log(f"drive{number + 1}.csv", SAMPLE_S, tuple(channels))))
    return Campaign(
        "drawn truck", "", Path(), Path("campaign.toml"), Vehicle("truck", (Body("body"),), axles), {"only": case},
        Acquisition(SAMPLE_S, None), (), (), {}, (), {}, road_drives=tuple(runs),
    )  # fmt: skip
