"""How far the vehicle departs from the model, from the data: residuals along the departures, and the size of each kind.

With the information H and gradient g of parameters x, masses m and departures a at the optimum of x for given y = (m,
a), of which the priors are N(0, L^-1),

    S = H_yy - H_yx (H_xx + P)^-1 H_xy,    y* | tau ~ N(y - (S + L)^-1 (g_y + L y), (S + L)^-1),
    L = diag(sd_m^-2, tau^-2).

All amplitudes of one kind have one scale tau, and their common part has another. The scales maximise the evidence and
are found by expectation-maximisation (D. J. C. MacKay, Bayesian interpolation, Neural Computation 4 (1992),
doi:10.1162/neco.1992.4.3.415):

    tau^2 <- mean over the kind of (E[a]^2 + var[a]).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.arrays import Masses, Parameters, ParametersByParameters
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.by_group import ByGroup, too_many
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import (
    BUMP,
    BUSHING,
    ENVELOPE,
    FOOTPRINT,
    FRICTION,
    SPOKES,
    TIRE_DAMPING,
    TIRE_LOAD,
    TRAILING,
    Departure,
)
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.residual_columns import (
    STEP,
    Difference,
    ResidualColumns,
    empty_columns,
    set_differences,
    trial_residuals,
)

#: Scales at which the search begins, and which it does not exceed: plausible values without any data. Assumptions: the
#: whole way to another contact law; 0.2 in the footprint's log stiffness and in the spokes' exponent; 10 % of a tire's
#: stiffness beyond its load law; 3 % of the load as friction (leaf packs have 2 to 10 %, general knowledge); bushings
#: of 4 MN/m (2 to 20 MN/m are usual, :data:`sysid.estimation.parameters.suspension_elements.BUSHING_STIFFNESS`); 5 % of
#: the height of a bump, which rubber gives under a wheel, and a scan may miss where it was taken; a tenth of the jounce
#: by which links and the fixed eyes of leaf packs lead a wheel fore or aft: a link of 0.6 m that slopes by 60 mm, its
#: pivot above or below the axle; half the way from damping that grows with the contact to one that does not, which most
#: published models of vehicles have.
PLAUSIBLE = {
    ENVELOPE: 1.0,
    FOOTPRINT: 0.2,
    SPOKES: 0.2,
    TIRE_LOAD: 0.1,
    FRICTION: 0.03,
    BUSHING: 0.25,
    BUMP: 0.05,
    TRAILING: 0.1,
    TIRE_DAMPING: 0.5,
}
#: Kinds that are let in only where the data show them: by the logarithm of the ratio of evidence with and without them,
#: and in this root mean square over the axles. Wheels that go 3 % of their jounce aft change k by some 0.3 %, less than
#: what else may look like them (assumptions).
EVIDENT, SHOWN_FROM = 5.0, {TRAILING: 0.03}
#: Changes of a departure count in at least this share of its plausible scale. Data that show none of a kind make its
#: scale arbitrarily small: friction of 1e-5 of the load is then a standard deviation, and changes nothing else.
_COUNTED = 0.01
#: Readings of a weighing scale are assumed to be off by no more than this many times their tolerance.
MOST_GROWN = 3.0
#: Rounds of expectation-maximisation, which ends when no scale changes by a thousandth.
_ROUNDS = 200


@dataclass(frozen=True)
class DepartureScale:
    """Scale tau (n,) of every direction, and the masses and amplitudes (m + n,) that the data require with it.

    `mass_sd` (m,): tolerances, enlarged for scale readings if the data require it.
    """

    sd: np.ndarray
    estimate: np.ndarray
    mass_sd: Masses


def departure_columns(
    model: BumpModel,
    allowances: Allowances,
    weights: Weights,
    log_parameters: Parameters,
    motion: RunMotion,
    amounts: np.ndarray,
) -> Sequence[ResidualColumns]:
    """Derivatives of every group's residuals (T, R, C, n) and gains (R, C, n) by n amplitudes, at `amounts` (q,).

    They are made when they are asked for if they are too many.  Where an axle departs already, steps go back towards
    the model: at the end of its reach it cannot go further.
    """
    known = allowances.departures
    count = len(known.directions)
    if too_many(model, count):

        def of(position: int) -> ResidualColumns:
            part = model.part(position), allowances, weights.part(position)
            return departure_columns(*part, log_parameters, motion, amounts)[0]

        return ByGroup(len(model.groups), of)
    columns = empty_columns(model, count)
    if count == 0:
        return columns
    log_factors, present = allowances.split(amounts)

    cases = [np.array([p.load_case for p in passes]) for passes in model.passes]
    # One simulation moves an axle in all load cases, because their runs are independent.
    together: dict[tuple[str, int], list[int]] = {}
    for j, d in enumerate(known.directions):
        if d.axle is not None:
            together.setdefault((d.kind, d.axle), []).append(j)
    steps = np.where(present + known.common(present) > 0.0, -STEP, STEP)
    amplitudes = [present]
    for members in together.values():
        further = present.copy()
        further[members] += steps[members]
        amplitudes.append(further)
    of_masses = allowances.with_masses(model, amounts)
    trials = (allowances.departed(of_masses, np.concatenate([log_factors, a])) for a in amplitudes)
    residuals = trial_residuals(model, weights, trials, log_parameters, motion)
    base = next(residuals)
    in_case = {d.load_case: [of_runs == d.load_case for of_runs in cases] for d in known.directions if d.load_case}
    differences = [
        [Difference(j, float(steps[j]), in_case.get(known.directions[j].load_case or "")) for j in members]
        for members in together.values()
    ]
    set_differences(columns, base, residuals, differences)
    for j, d in enumerate(known.directions):
        if d.axle is None:
            members = [i for i, m in enumerate(known.directions) if m.kind == d.kind and m.axle is not None]
            for column in columns:
                by_channel = column.by_channel
                for i in members:
                    by_channel[:, :, j] += by_channel[:, :, i]
                column.gain[..., j] = column.gain[..., members].sum(axis=-1)
    return columns


def least_sd(masses: int, directions: Sequence[Departure]) -> np.ndarray:
    """Standard deviations (m + n,) below which changes of m masses and n departures do not matter: none of a mass."""
    return np.concatenate([np.zeros(masses), [_COUNTED * PLAUSIBLE[d.kind] for d in directions]])


def departure_scale(
    information: np.ndarray,
    score: np.ndarray,
    prior: ParametersByParameters,
    mass_sd: Masses,
    directions: Sequence[Departure],
    amounts: np.ndarray | None = None,
    readings: np.ndarray | None = None,
    scales: np.ndarray | None = None,
) -> DepartureScale:
    """Scales of the kinds by expectation-maximisation.

    Readings of a weighing scale that are further off than their tolerance get a scale tau in the same way, never below
    the tolerance. No motion shows the error that all readings share. Its tolerance grows by the same factor: if the
    readings scatter more than declared, their mean is also assumed to be less accurate than declared (an assumption).

    Parameters
    ----------
    information : (p + m + n, p + m + n) data information; score : (p + m + n,) gradient of half the sum of squares,
        priors of the parameters included.
    prior : (p, p) prior precision; mass_sd : (m,) tolerances; directions : the n directions.
    amounts : (m + n,) y at which information and score were taken, None for 0.
    readings, scales : (m,) bool, which masses are readings of a scale, and what all its readings share; None for none.
    """
    sd = np.full(mass_sd.size + len(directions), np.inf)
    free = NormalEquations.of(information, score, prior=prior, sd=sd).eliminate(slice(len(prior))).left
    here = np.zeros(sd.size) if amounts is None else amounts
    # The parameters at their best for it, a parabola about `here` has this gradient at 0.
    at_zero = free.matrix, free.gradient - free.matrix @ here
    largest = np.array([PLAUSIBLE[d.kind] for d in directions])
    found = _most_evident(*at_zero, mass_sd, directions, largest, readings, scales)
    own = np.array([d.axle is not None for d in directions], dtype=bool)
    for kind, least in SHOWN_FROM.items():
        of_kind = np.array([d.kind == kind for d in directions], dtype=bool)
        if not of_kind.any():
            continue
        without = _most_evident(*at_zero, mass_sd, directions, np.where(of_kind, 0.0, largest), readings, scales)
        # The parts of their own have one scale, and what they have in common another.
        parts = (max(found[0].sd[of_kind & (own == part)], default=0.0) for part in (True, False))
        amplitude = float(np.linalg.norm(list(parts)))
        if amplitude < least or found[1] - without[1] < EVIDENT:
            found, largest = without, np.where(of_kind, 0.0, largest)
    return found[0]


def _most_evident(
    matrix: np.ndarray,
    gradient: np.ndarray,
    mass_sd: Masses,
    directions: Sequence[Departure],
    largest: np.ndarray,
    readings: np.ndarray | None,
    scales: np.ndarray | None,
) -> tuple[DepartureScale, float]:
    """Scales up to the `largest` (n,) from equations (m + n) at zero, and the logarithm of their evidence."""
    masses = mass_sd.size
    groups = np.array([d.group for d in directions])
    of_group = (groups[:, None] == groups).astype(float)
    mean_of_group = of_group / of_group.sum(axis=1, keepdims=True)
    tau = largest
    estimate, evidence, tolerance, mass_sd = np.zeros(gradient.size), 0.0, mass_sd, mass_sd.copy()
    for _ in range(_ROUNDS):
        scaled = NormalEquations.of(matrix, gradient, sd=np.concatenate([mass_sd, tau]))
        estimate, variance = scaled.step(), scaled.variances
        evidence = scaled.gain - 0.5 * scaled.log_determinant
        before = np.concatenate([tau, mass_sd])
        if readings is not None and readings.any():
            square = np.mean(estimate[:masses][readings] ** 2 + variance[:masses][readings])
            mass_sd[readings] = np.clip(np.sqrt(square), tolerance[readings], MOST_GROWN * tolerance[readings])
            if scales is not None:
                mass_sd[scales] = tolerance[scales] * float(np.max(mass_sd[readings] / tolerance[readings]))
        tau = np.minimum(np.sqrt(mean_of_group @ (estimate[masses:] ** 2 + variance[masses:])), largest)
        if np.all(np.abs(np.concatenate([tau, mass_sd]) - before) <= 1e-8 + 1e-3 * before):
            break
    return DepartureScale(tau, estimate, mass_sd), evidence
