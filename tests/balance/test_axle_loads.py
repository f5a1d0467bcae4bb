"""Axle loads of drives against forces that are written down here."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import welch
from test_balance_forces import LOADS, STEP, UNSPRUNG, C, K, campaign, motion

from sysid.balance import AxleLoads, balance_forces
from sysid.campaign.records import Campaign, RoadDrive
from sysid.export.driven_loads import coefficients_csv, driven_spectra_csv


def driven(noise: float = 1.0) -> Campaign:
    """The record as that of a drive."""
    given = campaign(noise, law="linear")
    (run,) = given.bump_runs
    return replace(given, bump_runs=(), road_drives=(RoadDrive("only", 15.0, run.log),))


@cache
def found(noise: float = 1.0) -> AxleLoads:
    (loads,) = balance_forces(driven(noise)).loads
    return loads


@cache
def forces() -> np.ndarray:
    """Under the tires (3, n): unsprung mass times acceleration, less the pull of spring and damper."""
    q, axle, _ = motion()
    rate = np.fft.irfft(2j * np.pi * np.fft.rfftfreq(q.shape[1], STEP) * np.fft.rfft(q, axis=1), q.shape[1], axis=1)
    return UNSPRUNG * axle - K[:, None] * q - C[:, None] * rate


def test_load_coefficients_are_those_of_the_forces_under_the_tires() -> None:
    true = forces().std(axis=1) / (9.81 * LOADS)
    assert found().coefficient == pytest.approx(true, rel=0.02)
    assert np.all((found().low < true) & (true < found().high))
    # The pull of the suspension alone is no axle load.
    pull = (forces() - UNSPRUNG * motion()[1]).std(axis=1) / (9.81 * LOADS)
    assert np.all(np.abs(found().coefficient / pull - 1.0) > 0.2)


def test_spectra_are_those_of_the_forces_under_the_tires() -> None:
    frequency, density = welch(forces(), 1.0 / STEP, nperseg=round(8.0 / STEP), axis=1)
    for low, high in ((1.0, 2.0), (2.0, 4.0), (4.0, 8.0), (8.0, 14.0), (14.0, 20.0)):
        true = density[:, (frequency >= low) & (frequency < high)].mean(axis=1)
        mine = found().density[:, (found().frequency_hz >= low) & (found().frequency_hz < high)].mean(axis=1)
        assert mine == pytest.approx(true, rel=0.06)


def test_noise_of_deflections_adds_no_load() -> None:
    """Twenty times the usual noise: what it adds is taken out, and intervals know it."""
    true = forces().std(axis=1) / (9.81 * LOADS)
    assert found(20.0).coefficient == pytest.approx(true, rel=0.05)
    fast = found().frequency_hz > 14.0
    widths = [((d.density_high - d.density_low) / d.density)[:, fast].mean() for d in (found(), found(20.0))]
    assert widths[1] > 1.2 * widths[0]


def test_an_unsprung_mass_within_its_tolerance_is_in_the_interval() -> None:
    """8 % more of the axle's mass than declared: the acceleration of the axle carries most of the load at hop."""
    given = driven()
    heavy = tuple(replace(a, unsprung_mass_kg=1.08 * a.unsprung_mass_kg) for a in given.vehicle.axles)
    case = given.load_cases["only"]
    lighter = replace(case, sprung_mass_kg=(case.sprung_mass_kg[0] - 0.08 * 3 * UNSPRUNG,))
    given = replace(given, vehicle=replace(given.vehicle, axles=heavy), load_cases={"only": lighter})
    (loads,) = balance_forces(given).loads
    assert np.all(loads.coefficient > 1.02 * found().coefficient)
    assert np.all(loads.low < found().coefficient)


def test_tables_have_a_row_per_axle_and_per_frequency() -> None:
    rows = coefficients_csv((found(),)).splitlines()
    assert rows[0].startswith("file,load_case,axle,used_s,static_load_N,load_coefficient_q05")
    assert len(rows) == 1 + 3
    assert float(rows[1].split(",")[6]) == found().coefficient[0]
    spectra = driven_spectra_csv((found(),)).splitlines()
    assert len(spectra) == 1 + found().frequency_hz.size
    assert float(spectra[9].split(",")[4]) == pytest.approx(1e-6 * found().density[0, 8])
