"""Whether parts of the data agree about stiffness and damping: the fit repeated with one part of them, and the rest.

At the joint optimum, the unknowns z (parameters, masses, departures) have the prior precision P, and the parts A and B
of the data the information H_A, H_B and gradients g_A, g_B. Fitted to A alone, the linear model ends F_A g_B away, and
to B alone F_B g_A, with F = (H + P)^-1. If the model is right, the difference of the two

    d = F_A g_B - F_B g_A    scatters by    V = F_A + F_B - F_A P F_B - F_B P F_A:

both share the priors, so what these say cancels. A model that lacks something of the truck takes other values to
explain slow runs than fast ones, an empty truck than a laden one, accelerations than deflections. How far they are
apart does not depend on the noise of the sensors, only how well it is seen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

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

    `least_seen`: what is more than chance, over all differences that are looked at.
    """

    part: str
    rest: str
    parameter: str
    quantity: str
    difference: float
    sd: float
    least_seen: float

    @property
    def seen(self) -> bool:
        """Whether it is more than chance."""
        return abs(self.difference) > self.least_seen

    @property
    def forbids(self) -> bool:
        """Whether the difference is seen and larger than anybody should accept."""
        return self.seen and abs(self.difference) > ACCEPTED[self.quantity]


@dataclass(frozen=True)
class PartAgreement:
    """All `differences`, and `rows` (k, p) whose squares they add to the covariance of the p parameters.

    Either part may be the right one: a difference that is seen adds half of itself as a standard deviation.
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
    prior : (p, p) precision of the log parameters; sd : (q,) prior standard deviations of masses and departures.
    """
    compared = [i for i, p in enumerate(parameters) if p.quantity in ACCEPTED]
    none = np.zeros(scores.shape[1:] * 2)
    of_priors = NormalEquations.of(none, prior=prior, sd=sd)
    found = []
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
    edge = norm.isf(0.5 * CHANCE / max(len(found) * len(compared), 1))
    differences, rows = [], np.zeros((len(found), len(parameters)))
    for row, (part, rest, difference, spread) in zip(rows, found, strict=True):
        row[compared] = np.where(np.abs(difference) > edge * spread, 0.5 * difference, 0.0)
        differences += [
            PartDifference(part, rest, parameters[i].name, parameters[i].quantity, float(d), float(s), float(edge * s))
            for i, d, s in zip(compared, difference, spread, strict=True)
        ]
    return PartAgreement(tuple(differences), rows[rows.any(axis=1)])


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
