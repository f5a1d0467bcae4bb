"""Axle loads, and what imitates wrong ones: spectra of trucks with a cab on springs of its own, solved by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sysid.bookkeeping import masses
from sysid.bookkeeping.force_balance import OwnSprings, RunSpectra, balance
from sysid.campaign.vehicle_records import Axle, Body, LoadCase, Vehicle

X_M, UNSPRUNG_KG = np.array([0.0, 4.2, 5.55]), np.array([520.0, 900.0, 860.0])
TIRE, TIRE_DAMPING = np.array([1.65e6, 2.9e6, 2.7e6]), 3.0e3
STIFFNESS, DAMPING = np.array([4.3e5, 9.5e5, 8.0e5]), np.array([1.05e4, 1.6e4, 1.4e4])
EMPTY = LoadCase("empty", (4100.0, 3300.0, 2880.0), (8000.0,), (25000.0,), (1.15,))
LADEN = LoadCase("laden", (5400.0, 8600.0, 8280.0), (20000.0,), (46000.0,), (1.55,))
VEHICLE = Vehicle(
    "truck",
    (Body("body"),),
    tuple(
        Axle(f"axle {i + 1}", 0, float(X_M[i]), float(UNSPRUNG_KG[i]), float(TIRE[i]), TIRE_DAMPING, 0.5, "leaf")
        for i in range(3)
    ),
)
#: Mass [kg], place [m], frequency [Hz] and damping ratio.
CAB = (700.0, 0.2, 2.0, 0.15)


def spectra(case: LoadCase, speed_m_s: float, cab: tuple[float, ...] | None, noise: float = 0.02) -> RunSpectra:
    """A run over a raised cosine of 75 mm by 0.9 m: (K + i w C - w^2 M) u = kt r, matrices written out.

    u: rise of the frame at x = 0, its nose-up pitch, rise of the cab against the frame, rises of the axles.
    """
    carried = np.array(case.axle_loads_kg) - UNSPRUNG_KG
    mass, centre = carried.sum(), float(carried @ X_M / carried.sum())
    unit = np.eye(6)

    def frame(x: float) -> np.ndarray:
        return unit[0] - x * unit[1]

    m = mass * np.outer(frame(centre), frame(centre)) + case.pitch_inertia_kg_m2[0] * np.outer(unit[1], unit[1])
    k, c = np.zeros((6, 6)), np.zeros((6, 6))
    if cab is None:
        m += np.outer(unit[2], unit[2])
    else:
        of_cab, x, hz, ratio = cab
        above, against = frame(x) + unit[2], np.outer(unit[2], unit[2])
        m += of_cab * (np.outer(above, above) - np.outer(frame(x), frame(x)))
        k += of_cab * (2.0 * np.pi * hz) ** 2 * against
        c += 2.0 * ratio * of_cab * 2.0 * np.pi * hz * against
    extension = np.array([frame(x) - unit[3 + i] for i, x in enumerate(X_M)])
    for i in range(3):
        wheel = np.outer(unit[3 + i], unit[3 + i])
        m += UNSPRUNG_KG[i] * wheel
        k += STIFFNESS[i] * np.outer(extension[i], extension[i]) + TIRE[i] * wheel
        c += DAMPING[i] * np.outer(extension[i], extension[i]) + TIRE_DAMPING * wheel
    omega = 2.0 * np.pi * np.arange(0.8, 6.0, 0.1)
    s = np.linspace(-0.45, 0.45, 201)
    motion = []
    for w in omega:
        bump = np.trapezoid(0.0375 * (1.0 + np.cos(2.0 * np.pi * s / 0.9)) * np.exp(-1j * w * s / speed_m_s), s)
        push = np.zeros(6, complex)
        push[3:] = (TIRE + 1j * w * TIRE_DAMPING) * bump * np.exp(-1j * w * X_M / speed_m_s)
        motion.append(np.linalg.solve(k + 1j * w * c - w**2 * m, push))
    u = np.array(motion).T
    rng = np.random.default_rng([3, round(10.0 * speed_m_s), len(case.name)])

    def measured(value: np.ndarray) -> np.ndarray:
        size = noise * np.sqrt(0.5 * np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
        return value + size * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))

    deflection = measured(extension @ u)
    file = f"{case.name}_{speed_m_s:.1f}.csv"
    return RunSpectra(file, case.name, measured(-(omega**2) * u[:2]), deflection, 1j * omega * deflection, omega)


def said(*cases: LoadCase, cab: tuple[float, ...] | None = CAB, listed_from_the_rear: bool = False) -> str:
    """Complaints about load cases that are listed rightly, or from the rear."""
    runs = [spectra(case, v, cab) for case in cases for v in (2.2, 4.4, 6.7)]
    listed = [replace(c, axle_loads_kg=c.axle_loads_kg[:: -1 if listed_from_the_rear else 1]) for c in cases]
    campaign = SimpleNamespace(vehicle=VEHICLE, load_cases={c.name: c for c in listed})
    return " ".join(masses.mass_complaints(campaign, runs))


@pytest.mark.parametrize("cases", [(EMPTY,), (LADEN,), (EMPTY, LADEN)])
def test_a_cab_on_springs_of_its_own_is_no_wrong_list_of_loads(cases, monkeypatch) -> None:
    assert said(*cases) == ""
    # Without a part on springs among the explanations, the loads of the empty truck were accused.
    monkeypatch.setattr(masses, "_with_a_part", lambda *_: np.inf)
    assert ("axle_loads_kg in the opposite order" in said(*cases)) == (EMPTY in cases)


@pytest.mark.parametrize("cab", [None, CAB])
def test_loads_from_the_rear_are_named_with_and_without_a_cab(cab) -> None:
    assert said(EMPTY, LADEN, cab=None) == ""
    text = said(EMPTY, LADEN, cab=cab, listed_from_the_rear=True)
    assert "'laden': the frames move as with axle_loads_kg in the opposite order" in text


def test_the_share_of_a_part_comes_back_from_its_motion() -> None:
    """700 of 8000 kg, with the damping that the balance supposes."""
    runs = [spectra(EMPTY, v, CAB, noise=0.0) for v in (2.2, 4.4, 6.7)]
    found = balance(runs, VEHICLE, [EMPTY] * 3, part=OwnSprings(CAB[1], CAB[2]))
    assert found is not None
    assert found.freed[-1] == pytest.approx(CAB[0] / 8000.0, rel=1e-6)
    assert found.stiffness == pytest.approx(STIFFNESS, rel=1e-6)
    assert found.damping == pytest.approx(DAMPING, rel=1e-6)
    wrong = balance(runs, VEHICLE, [EMPTY] * 3)
    assert wrong is not None
    assert np.max(np.abs(wrong.stiffness / STIFFNESS - 1.0)) > 0.02
