"""One simulated fleet of Gaussian campaigns with known truth, and what the population model says of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from sysid.fleet.hierarchy import HyperPriors, TypeData
from sysid.fleet.population import find_outliers, fit_population, stand_alone
from sysid.posterior.options import SamplingOptions

SEED = 2026
TRUCKS, CAMPAIGNS, AXLES = 8, 2, 3
NAMES = tuple(f"{q}_{i + 1}" for q in "kc" for i in range(AXLES))
QUANTITIES = ("stiffness",) * AXLES + ("damping",) * AXLES
#: Fewer draws than the product takes: their error is small beside the width of an interval.
SAMPLING = SamplingOptions(ensembles=4, segment_steps=100, min_steps=200, max_steps=3000, min_effective=400.0)
#: Ranges of the relative standard deviations of k and of c (assumptions): between healthy trucks of one type, of
#: repeats of one truck, and of one campaign, as calibrations of simulated trucks have them.
SPREAD = {"stiffness": (0.04, 0.12), "damping": (0.05, 0.12)}
SCATTER = {"stiffness": (0.005, 0.02), "damping": (0.01, 0.04)}
WIDTH = {"stiffness": (0.015, 0.04), "damping": (0.03, 0.08)}
#: The same of c where trucks differ more.
WIDE = (0.08, 0.20)
#: What a broken damper leaves of c.
BROKEN = 0.5


def simulate(
    number: int, seed: int, broken: bool, wide: bool = False
) -> tuple[TypeData, dict[str, np.ndarray], tuple[int, int] | None]:
    """A fleet: its campaigns, truth by name, and truck and parameter of the broken damper."""
    random = np.random.default_rng([seed, number, int(broken)])
    d = len(NAMES)

    def each(ranges: dict[str, tuple[float, float]]) -> np.ndarray:
        return np.array([random.uniform(*ranges[q]) for q in QUANTITIES])

    tau, mean = each(SPREAD | {"damping": WIDE} if wide else SPREAD), random.normal(0.0, 0.5, d)
    phi = np.repeat([random.uniform(*SCATTER[q]) for q in dict.fromkeys(QUANTITIES)], AXLES)
    correlation = np.eye(d)
    for start in (0, AXLES):
        at = slice(start, start + AXLES)
        rho = random.uniform(0.0, 0.6)
        correlation[at, at] = rho + (1.0 - rho) * np.eye(AXLES)
    trucks = random.multivariate_normal(mean, tau[:, None] * correlation * tau, TRUCKS)
    where = None
    if broken:
        where = (int(random.integers(TRUCKS)), AXLES + int(random.integers(AXLES)))
        trucks[where] += np.log(BROKEN)
    truck_of = np.repeat(np.arange(TRUCKS), CAMPAIGNS)
    precision, shift = [], []
    for t in truck_of:
        sd = each(WIDTH)
        mixed = np.linalg.qr(np.eye(d) + 0.3 * random.standard_normal((d, d)))[0]
        share = mixed @ np.diag(random.uniform(0.5, 1.5, d)) @ mixed.T
        scale = sd / np.sqrt(np.diag(share))
        covariance = scale[:, None] * share * scale
        value = random.multivariate_normal(trucks[t] + phi * random.standard_normal(d), covariance)
        precision.append(np.linalg.inv(covariance))
        shift.append(precision[-1] @ value)
    names = tuple(f"T{t + 1}" for t in range(TRUCKS))
    campaigns = tuple(f"{names[t]}-{i % CAMPAIGNS + 1}" for i, t in enumerate(truck_of))
    data = TypeData(NAMES, QUANTITIES, names, campaigns, truck_of, np.array(precision), np.array(shift), np.zeros(d))
    return data, {"mean": mean, "spread": tau, "trucks": trucks}, where


def replicate(number: int, *, seed: int = SEED, broken: bool = False) -> dict[str, Any]:
    """What the model says of one fleet: intervals that hold, errors with and without shrinkage, outliers found."""
    data, truth, where = simulate(number, seed, broken)
    units = ("N/m",) * AXLES + ("N s/m",) * AXLES
    found = fit_population("truck", data, units, [None] * len(data.campaigns), sampling=SAMPLING)
    trucks = np.exp(truth["trucks"])
    return {
        "number": number,
        "broken": None if where is None else [data.trucks[where[0]], NAMES[where[1]]],
        "converged": found.converged,
        "mean": _held(found.mean, np.exp(truth["mean"])),
        "spread": _held(found.spread, truth["spread"]),
        "trucks": _held(found.trucks, trucks),
        "alone_error": np.log(found.alone.q50 / trucks).ravel().tolist(),
        "shrunk_error": np.log(found.trucks.q50 / trucks).ravel().tolist(),
        "outliers": [[o.truck, o.parameter, o.factor, o.probability] for o in found.outliers],
    }


def _held(interval: Any, truth: np.ndarray) -> list[bool]:
    return ((interval.q05 <= truth) & (truth <= interval.q95)).ravel().tolist()


def outliers(number: int, *, seed: int = SEED, broken: bool = True, wide: bool = False) -> dict[str, Any]:
    """The outliers of one fleet alone, without sampling: the broken one and those that are named."""
    data, _, where = simulate(number, seed, broken, wide)
    priors = HyperPriors()
    found = find_outliers(data, stand_alone(data, priors), priors)
    return {
        "number": number,
        "broken": None if where is None else [data.trucks[where[0]], NAMES[where[1]]],
        "outliers": [[o.truck, o.parameter, o.factor, o.probability] for o in found],
    }
