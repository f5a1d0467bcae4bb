"""Whether parts of the data agree about stiffness and damping: the fit repeated with one part of them, and the rest.

At the joint optimum, the unknowns z (parameters, masses, departures) have the prior precision P, and the parts A and B
of the data the information H_A, H_B and gradients g_A, g_B. Fitted to A alone, the linear model ends F_A g_B away, and
to B alone F_B g_A, with F = (H + P)^-1. If the model is right, the difference of the two

    d = F_A g_B - F_B g_A    scatters by    V = F_A + F_B - F_A P F_B - F_B P F_A:

both share the priors, so what these say cancels. Differences of all divisions together scatter by

    V_jl = sum over blocks of C_j H C_l' + (F_A - F_B)_j P (F_A - F_B)_l',    C = -F_A for blocks of A, F_B of B.

What they scatter more is what the model lacks, and is seen in many small differences before it is seen in one. With the
sum Q of the squares of n differences over their variances, a further variance of all of them

    tau^2 = (Q - n) / sum of 1 / V_jj

(R. DerSimonian and N. Laird, Meta-analysis in clinical trials, Controlled Clinical Trials 7 (1986),
doi:10.1016/0197-2456(86)90046-2). It counts where Q is larger than chance makes it, by a chi-square with the mean and
variance of Q (F. E. Satterthwaite 1946, doi:10.2307/3002019). A model that lacks something of the truck takes other
values to explain slow runs than fast ones, an empty truck than a laden one, accelerations than deflections. How far
they are apart does not depend on the noise of the sensors, only how well it is seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np
from scipy.stats import chi2, norm

from sysid.arrays import ParametersByParameters
from sysid.campaign.records import SensorKind
from sysid.estimation.parameters.parameter_set import Parameter
from sysid.estimation.uncertainty.normal_equations import NormalEquations

#: Probability that any difference of a right model is called one.
CHANCE = 0.01
#: Quantities that are compared, and by how much parts may differ in them for somebody to rely on the whole: what the
#: program claims for stiffness and damping of a truck that its model describes.
ACCEPTED = {"stiffness": 0.02, "damping": 0.05}
_SENSORS: dict[SensorKind, str] = {
    "suspension_deflection": "the deflections",
    "axle_acceleration": "the axle accelerations",
    "body_acceleration": "the body accelerations",
    "pitch_rate": "the pitch rates",
    "air_pressure": "the air pressures",
    "speed": "the measured speeds",
}


@dataclass(frozen=True)
class Block:
    """Which residuals belong together: one channel in all repeats of one case of runs.

    Without a channel: the priors of the runs' own motions in a load case.
    """

    load_case: str
    case: str = ""
    bump: str = ""
    speed_m_s: float | None = None
    channel: int | None = None
    sensor: SensorKind | None = None


@dataclass(frozen=True)
class PartDifference:
    """By how much a parameter differs between a `part` of the data and the `rest`, logarithms: `difference`, `sd`.

    `least_seen`: what is more than chance, over all differences that are looked at. `scatter`: standard deviation of
    all differences of the quantity beyond chance, 0 where they show none.
    """

    part: str
    rest: str
    parameter: str
    quantity: str
    difference: float
    sd: float
    least_seen: float
    scatter: float = 0.0

    @property
    def seen(self) -> bool:
        """Whether it is more than chance."""
        return abs(self.difference) > self.least_seen

    @property
    def forbids(self) -> bool:
        """Whether the difference is seen and larger than anybody should accept."""
        return self.seen and abs(self.difference) > ACCEPTED[self.quantity]

    @property
    def scattered(self) -> bool:
        """Whether all differences of the quantity scatter by more than anybody should accept."""
        return self.scatter > ACCEPTED[self.quantity]


@dataclass(frozen=True)
class PartAgreement:
    """All `differences`, and `rows` (k, p) whose squares they add to the covariance of the p parameters.

    Either part may be the right one: a difference that is seen adds half of itself as a standard deviation, and every
    parameter has at least half of the scatter.
    """

    differences: tuple[PartDifference, ...]
    rows: np.ndarray


def part_agreement(
    parameters: Sequence[Parameter],
    blocks: Sequence[Block],
    scores: np.ndarray,
    information: np.ndarray,
    prior: ParametersByParameters,
    sd: np.ndarray,
) -> PartAgreement:
    """Differences of stiffness and damping between parts of the data.

    Parameters
    ----------
    parameters : the p parameters of the fit.
    blocks : what each of the b blocks holds.
    scores : (b, p + q) gradients of half the sum of squares at the joint optimum; information : (b, p + q, p + q).
    prior : (p, p) precision of the log parameters; sd : (q,) prior standard deviations of masses and departures, 0 for
        those that stay at the end of their range.
    """
    compared = [i for i, p in enumerate(parameters) if p.quantity in ACCEPTED]
    none = np.zeros(scores.shape[1:] * 2)
    of_priors = NormalEquations.of(none, prior=prior, sd=sd)
    found, divisions = [], []
    for part, rest, inside in _parts(blocks):
        of_part, of_rest = (
            NormalEquations.of(information[m].sum(axis=0), scores[~m].sum(axis=0), prior=prior, sd=sd)
            for m in (inside, ~inside)
        )
        # A step goes against the gradient: towards what the other part pulls away from.
        difference = of_rest.step() - of_part.step()
        both = of_part.covariance @ _in_units(of_priors) @ of_rest.covariance
        spread = of_part.variances + of_rest.variances - 2.0 * np.diag(both)
        found.append((part, rest, difference[compared], np.sqrt(np.maximum(spread[compared], 0.0))))
        divisions.append(((inside, -of_part.covariance[compared]), (~inside, of_rest.covariance[compared])))
    edge = norm.isf(0.5 * CHANCE / max(len(found) * len(compared), 1))
    together = _covariance(divisions, information, _in_units(of_priors))
    scatter = _scatter(
        np.array([d for _, _, difference, _ in found for d in difference]),
        together,
        np.array([parameters[i].quantity for i in compared] * len(found)),
    )
    differences, rows = [], np.zeros((len(found), len(parameters)))
    for row, (part, rest, difference, spread) in zip(rows, found, strict=True):
        row[compared] = np.where(np.abs(difference) > edge * spread, 0.5 * difference, 0.0)
        differences += [
            PartDifference(part, rest, p.name, p.quantity, float(d), float(s), float(edge * s), scatter[p.quantity])
            for p, d, s in zip((parameters[i] for i in compared), difference, spread, strict=True)
        ]
    missing = [0.25 * scatter.get(p.quantity, 0.0) ** 2 for p in parameters] - np.sum(rows**2, axis=0)
    rows = np.concatenate([rows, np.diag(np.sqrt(np.maximum(missing, 0.0)))])
    return PartAgreement(tuple(differences), rows[rows.any(axis=1)])


#: Blocks of a part, and how a difference follows from their scores: rows (k, n).
Side: TypeAlias = tuple[np.ndarray, np.ndarray]


def _covariance(
    divisions: Sequence[tuple[Side, Side]], information: np.ndarray, precision: np.ndarray
) -> ParametersByParameters:
    """Covariance (d k, d k) of k differences in each of d divisions."""
    lines = []
    for one in divisions:
        of_priors = (one[0][1] + one[1][1]) @ precision
        line = []
        for other in divisions:
            total = of_priors @ (other[0][1] + other[1][1]).T
            for (mine, rows), (theirs, columns) in product(one, other):
                shared = np.tensordot((mine & theirs).astype(float), information, 1)
                total = total + rows @ shared @ columns.T
            line.append(total)
        lines.append(line)
    return np.block(lines) if lines else np.zeros((0, 0))


def _scatter(differences: np.ndarray, covariance: np.ndarray, quantities: np.ndarray) -> dict[str, float]:
    """Standard deviation tau of the differences (m,) of each quantity beyond chance."""
    variance = np.diag(covariance)
    told = variance > 0.0
    scatter = dict.fromkeys(ACCEPTED, 0.0)
    for quantity in ACCEPTED:
        chosen = told & (quantities == quantity)
        if not chosen.any():
            continue
        count, own = int(chosen.sum()), variance[chosen]
        squares = float(np.sum(differences[chosen] ** 2 / own))
        correlation = covariance[np.ix_(chosen, chosen)] / np.sqrt(np.outer(own, own))
        # Q has the mean n and the variance 2 sum of rho^2: that of `unit` times a chi-square.
        unit = float(np.sum(correlation**2)) / count
        if squares > unit * chi2.isf(CHANCE / len(ACCEPTED), count / unit):
            scatter[quantity] = float(np.sqrt((squares - count) / np.sum(1.0 / own)))
    return scatter


def _in_units(equations: NormalEquations) -> np.ndarray:
    """Precision of the unknowns themselves; those that are held have none, and their covariances are zero."""
    unit = np.where(equations.unit > 0.0, equations.unit, np.inf)
    return np.asarray(equations.matrix / np.outer(unit, unit))


def _parts(blocks: Sequence[Block]) -> Iterator[tuple[str, str, np.ndarray]]:
    """Names of parts and of their rests, and which blocks (b,) they hold; every division once."""
    taken: list[np.ndarray] = []
    for part, rest, holds in _divisions([b for b in blocks if b.sensor is not None]):
        inside = np.array([holds(b) for b in blocks])
        if any((inside == t).all() or (inside == ~t).all() for t in taken):
            continue
        taken.append(inside)
        yield part, rest, inside


def _divisions(blocks: Sequence[Block]) -> Iterator[tuple[str, str, Callable[[Block], bool]]]:
    cases = list(dict.fromkeys(b.load_case for b in blocks))
    for case in cases if len(cases) > 1 else []:
        other = [c for c in cases if c != case]
        rest = f"'{other[0]}'" if len(other) == 1 else "the other load cases"
        yield f"the load case '{case}'", rest, lambda b, case=case: b.load_case == case  # type: ignore[misc]
    slow, fast = set(), set()
    for case in cases:
        speeds = sorted({b.speed_m_s for b in blocks if b.load_case == case and b.speed_m_s is not None})
        half = len(speeds) // 2
        slow |= {(case, v) for v in speeds[:half]}
        fast |= {(case, v) for v in speeds[len(speeds) - half :]}
    if slow:
        yield "the slower runs", "the other runs", lambda b: (b.load_case, b.speed_m_s) in slow
        yield "the faster runs", "the other runs", lambda b: (b.load_case, b.speed_m_s) in fast
    kinds = list(dict.fromkeys(b.sensor for b in blocks if b.sensor is not None))
    for kind in kinds if len(kinds) > 1 else []:
        yield _SENSORS[kind], "the other sensors", lambda b, kind=kind: b.sensor == kind  # type: ignore[misc]
