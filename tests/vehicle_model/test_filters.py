"""The anti-alias recursion against the analogue filter: exact responses of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import expm

from sysid.campaign.records import AntiAliasFilter
from sysid.vehicle_model.filters import FilterRecursion, analogue_transfer, discretise

SPECS = [
    AntiAliasFilter("butterworth", 4, 60.0),
    AntiAliasFilter("butterworth", 3, 80.0),
    AntiAliasFilter("butterworth", 1, 30.0),
    AntiAliasFilter("butterworth", 12, 200.0),
    AntiAliasFilter("bessel", 4, 60.0),
    AntiAliasFilter("bessel", 5, 100.0),
]


def design(spec: AntiAliasFilter, output: str = "ba") -> tuple:
    """The analogue filter straight from SciPy; a Bessel filter is 3 dB down at its cut-off."""
    if spec.kind == "bessel":
        return signal.bessel(spec.order, 2 * np.pi * spec.cutoff_hz, analog=True, norm="mag", output=output)
    return signal.butter(spec.order, 2 * np.pi * spec.cutoff_hz, analog=True, output=output)


def apply(recursion: FilterRecursion, now: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Run the recursion as its docstring states it, from rest (a zero state belongs to a first input of zero)."""
    state = np.zeros(recursion.decay.size, complex)
    shown = np.empty(now.size)
    for n in range(now.size):
        shown[n] = np.sum(recursion.weight * (state + recursion.feed * now[n])).real
        state = recursion.decay * state + recursion.start * now[n] + recursion.middle * middle[n]
    return shown


@pytest.mark.parametrize("spec", SPECS, ids=lambda s: f"{s.kind}{s.order}")
def test_partial_fractions_are_the_declared_filter(spec):
    poles, residues = analogue_transfer(spec)
    frequency = np.array([0.0, 1.0, spec.cutoff_hz / 2, spec.cutoff_hz, 3 * spec.cutoff_hz])
    ours = (residues / (2j * np.pi * frequency[:, None] - poles)).sum(axis=1)
    exact = signal.freqs_zpk(*design(spec, "zpk"), worN=2 * np.pi * frequency)[1]
    np.testing.assert_allclose(ours, exact, rtol=1e-10, atol=1e-12)
    assert abs(ours[0]) == pytest.approx(1.0, abs=1e-11)
    assert abs(ours[3]) == pytest.approx(np.sqrt(0.5), abs=1e-8)


@pytest.mark.parametrize("spec", SPECS, ids=lambda s: f"{s.kind}{s.order}")
def test_a_quadratic_input_is_filtered_exactly(spec):
    """Over every step the input is quadratic, so the recursion equals the convolution to rounding."""
    h, steps = 0.002, 150
    t = np.arange(steps) * h
    coefficients = (0.0, -2.0, 25.0)
    now = np.polynomial.polynomial.polyval(t, coefficients)
    middle = np.polynomial.polynomial.polyval(t + h / 2, coefficients)
    ours = apply(discretise(spec, h), now, middle)
    # Exact: state-space with the input's derivatives as extra states, by the matrix exponential.
    _, poles, gain = design(spec, "zpk")
    # A chain of first-order lags keeps the oracle well conditioned: y_k' = p_k y_k + y_(k-1).
    n = len(poles)
    a, b, c = np.diag(poles) + np.diag(np.ones(n - 1), -1), np.eye(n, 1), gain * np.eye(n)[-1:]
    system = np.zeros((n + 3, n + 3), complex)
    system[:n, :n], system[:n, n : n + 1] = a, b
    system[n, n + 1] = system[n + 1, n + 2] = 1.0
    step = expm(system * h)
    state = np.array([0j] * n + [coefficients[0], coefficients[1], 2 * coefficients[2]])
    exact = np.empty(steps)
    for k in range(steps):
        exact[k] = (c @ state[:n])[0].real
        state = step @ state
    np.testing.assert_allclose(ours, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize("spec", SPECS, ids=lambda s: f"{s.kind}{s.order}")
@pytest.mark.parametrize("frequency_hz", [2.0, 12.0, 40.0])
def test_a_sine_leaves_with_the_analogue_amplitude_and_phase(spec, frequency_hz):
    h = 0.0025
    t = np.arange(int(1.0 / h)) * h
    omega = 2 * np.pi * frequency_hz
    ours = apply(discretise(spec, h), np.sin(omega * t), np.sin(omega * (t + h / 2)))
    response = signal.freqs(*design(spec), worN=[omega])[1][0]
    settled = t > 0.6
    exact = np.imag(response * np.exp(1j * omega * t))
    # Quadratic interpolation of the input leaves an error of order (omega h)^3 / 72.
    assert np.abs(ours - exact)[settled].max() < 1e-6 + (omega * h) ** 3 / 72


def test_agrees_with_a_fine_simulation_of_a_rough_input():
    spec = SPECS[0]
    h, steps, fine = 0.001, 400, 40
    rng = np.random.default_rng(5)
    t = np.arange(steps * fine) * (h / fine)
    amplitude, frequencies = rng.normal(size=12), np.linspace(1, 60, 12)
    rough = (amplitude[:, None] * np.sin(2 * np.pi * frequencies[:, None] * t)).sum(axis=0)
    exact = signal.lsim(design(spec), rough, t)[1][::fine]
    ours = apply(discretise(spec, h), rough[::fine], rough[fine // 2 :: fine])
    assert np.sqrt(np.mean((ours - exact) ** 2) / np.mean(exact**2)) < 1e-4


def test_recursions_of_one_filter_and_step_are_equal():
    """Functions are compiled once for them; another filter or step has coefficients of its own."""
    spec = AntiAliasFilter("butterworth", 4, 60.0)
    one, same = discretise(spec, 0.00125), discretise(spec, 0.00125)
    assert one == same
    assert hash(one) == hash(same)
    assert discretise(spec, 0.0025) != one
    assert discretise(AntiAliasFilter("butterworth", 4, 61.0), 0.00125) != one
