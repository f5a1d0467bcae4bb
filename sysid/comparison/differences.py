"""Differences of two campaigns with the errors cancelled that both share.

Logarithms x of the quantities of either campaign go with errors y of declared masses and of the contact model,

    x | y ~ N(m + G (y - y_0), S),    S = C - G Y G',    y ~ N(y_0, Y),

with covariances C and Y that include the prior N(0, L^-1) of y. Errors that both campaigns (a, b) share are one vector,
of which both say something; the prior counts once:

    Y^-1 = (Y_a^-1 - L) + (Y_b^-1 - L) + L,    Y^-1 y_0 = Y_a^-1 y_a + Y_b^-1 y_b.

All other errors are of one campaign alone. So the difference is normal,

    x_b - x_a ~ N(m_b + G_b (y_0 - y_b) - m_a - G_a (y_0 - y_a), S_a + S_b + (G_b - G_a) Y (G_b - G_a)').

Of many quantities some seem to differ by chance. Whether one has changed is decided by the procedure of S. Holm (A
simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 1979): among quantities of
one family of which none has changed, one is called changed with a probability of at most :data:`ERROR_RATE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from sysid.comparison.records import Difference, Family
from sysid.comparison.shared import SharedErrors
from sysid.comparison.stored import StoredEstimate, StoredPeak, StoredResult
from sysid.display import Z90
from sysid.numbers import listing

#: Probability of calling something changed in a family in which nothing has.
ERROR_RATE = 0.05
#: Quantities that say how a law bends or where a stop is: they are compared, but follow from few passages.
_TIRE = "tire"


@dataclass(frozen=True)
class _Quantities:
    """Quantities of one campaign, n logarithms: medians (n,), `covariance` C (n, n), `sensitivity` G (n, s) to shared
    errors y, their estimate (s,), covariance Y (s, s) and prior standard deviations (s,).
    """

    middle: np.ndarray
    covariance: np.ndarray
    sensitivity: np.ndarray
    estimate: np.ndarray
    error_covariance: np.ndarray
    prior_sd: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """Y^-1 - L: what the data of this campaign say of the shared errors."""
        return np.asarray(np.linalg.inv(self.error_covariance) - np.diag(self.prior_sd**-2.0))

    @property
    def alone(self) -> np.ndarray:
        """S (n, n): what is left if the shared errors are known. Rounding and model error make nothing negative."""
        left = self.covariance - self.sensitivity @ self.error_covariance @ self.sensitivity.T
        unit = np.sqrt(np.diag(self.covariance))
        scale = np.where(unit > 0.0, unit, 1.0)
        values, vectors = np.linalg.eigh(0.5 * (left + left.T) / np.outer(scale, scale))
        return np.asarray(np.outer(scale, scale) * ((vectors * np.maximum(values, 0.0)) @ vectors.T))


def log_differences(first: _Quantities, second: _Quantities) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n,) and covariance (n, n) of the logarithms of the second campaign less those of the first."""
    mean, left = second.middle - first.middle, first.alone + second.alone
    if not first.prior_sd.size:
        return mean, left
    # A scale that one campaign needed wider is that of both.
    precision = np.diag(np.maximum(first.prior_sd, second.prior_sd) ** -2.0)
    common = np.linalg.inv(first.information + second.information + precision)
    both = (np.linalg.solve(q.error_covariance, q.estimate) for q in (first, second))
    at = common @ sum(both)
    mean = mean + second.sensitivity @ (at - second.estimate) - first.sensitivity @ (at - first.estimate)
    apart = second.sensitivity - first.sensitivity
    return mean, left + apart @ common @ apart.T


def compared(first: StoredResult, second: StoredResult, shared: SharedErrors) -> tuple[list[Difference], list[str]]:
    """All differences of two campaigns, and sentences about what cannot be compared."""
    pairs, remarks = _parameter_pairs(first, second)
    found: list[Difference] = []
    families: tuple[tuple[Family, bool], ...] = (("suspension", False), ("tires", True))
    for family, of_tires in families:
        chosen = [(i, j) for i, j in pairs if first.estimates[i].quantity.startswith(_TIRE) == of_tires]
        if chosen:
            found += _parameters(first, second, chosen, shared, family)
    loads, said = _static_loads(first, second, shared)
    peaks, also = _peaks(first, second)
    return [*found, *loads, *peaks], [*remarks, *said, *also]


def _parameter_pairs(first: StoredResult, second: StoredResult) -> tuple[list[tuple[int, int]], list[str]]:
    """Indices of the same parameter in both campaigns, and why others have no partner."""
    pairs, alone, laws, open_ = [], [], [], []
    taken: set[int] = set()
    for i, a in enumerate(first.estimates):
        j = _partner(a, first, second)
        if j is None or j in taken:
            alone.append(a.name)
            continue
        taken.add(j)
        b = second.estimates[j]
        if not (a.identified and b.identified):
            open_.append(a.name)
        elif a.law != b.law and not a.quantity.startswith(_TIRE):
            laws.append(f"{a.name} ({a.law}, then {b.law})")
        else:
            pairs.append((i, j))
    alone += [b.name for j, b in enumerate(second.estimates) if j not in taken]
    remarks = []
    if laws:
        remarks.append(
            f"Not compared, as the suspension laws differ and the values mean different things: {listing(laws)}. "
            "Declare suspension_law in both campaign files, or use --laws declared, and fit again."
        )
    if open_:
        remarks.append(f"Not compared, as the data of a campaign do not determine them: {listing(open_)}.")
    if alone:
        remarks.append(f"In one campaign only: {listing(list(dict.fromkeys(alone)))}.")
    return pairs, remarks


def _partner(a: StoredEstimate, first: StoredResult, second: StoredResult) -> int | None:
    """The same quantity of the other campaign; in its only load case, where that has another name."""
    alike = [j for j, b in enumerate(second.estimates) if (b.quantity, b.axle) == (a.quantity, a.axle)]
    same = [j for j in alike if second.estimates[j].load_case == a.load_case]
    if same:
        return same[0]
    others = [e for e in first.estimates if (e.quantity, e.axle) == (a.quantity, a.axle)]
    return alike[0] if len(alike) == 1 and len(others) == 1 else None


def _shared_part(result: StoredResult, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Prior sd (s,), estimate (s,) and covariance (s, s) of some errors y, and C(x, y) (p, s) of all parameters."""
    sd = np.array([result.errors[k].sd for k in chosen])
    estimate = sd * np.array([result.errors[k].estimate for k in chosen])
    covariance = np.outer(sd, sd) * result.error_covariance[np.ix_(chosen, chosen)]
    together = (result.sensitivity @ result.error_covariance)[:, list(chosen)] * sd
    return sd, estimate, covariance, together


def _quantities(result: StoredResult, rows: Sequence[int], chosen: Sequence[int]) -> _Quantities:
    """Some parameters of a campaign beside some errors; all other errors are integrated out."""
    middle = np.array([result.estimates[i].log_value for i in rows])
    covariance = result.covariance[np.ix_(rows, rows)]
    if not chosen:
        none = np.zeros(0)
        return _Quantities(middle, covariance, np.zeros((len(rows), 0)), none, np.zeros((0, 0)), none)
    sd, estimate, known, together = _shared_part(result, chosen)
    sensitivity = np.linalg.solve(known, together[list(rows)].T).T
    return _Quantities(middle, covariance, sensitivity, estimate, known, sd)


def _parameters(
    first: StoredResult,
    second: StoredResult,
    pairs: Sequence[tuple[int, int]],
    shared: SharedErrors,
    family: Family,
) -> list[Difference]:
    rows, columns = ([p[side] for p in pairs] for side in (0, 1))
    chosen, others = ([p[side] for p in shared.pairs] for side in (0, 1))
    before, after = _quantities(first, rows, chosen), _quantities(second, columns, others)
    mean, covariance = log_differences(before, after)
    found = []
    for n, (i, j) in enumerate(pairs):
        a, b = first.estimates[i], second.estimates[j]
        found.append(
            Difference(
                family,
                a.name,
                a.quantity,
                a.axle,
                (a.load_case, b.load_case),
                a.unit,
                _band(before.middle[n], before.covariance[n, n]),
                _band(after.middle[n], after.covariance[n, n]),
                float(mean[n]),
                float(np.sqrt(max(covariance[n, n], 0.0))),
            )
        )
    return _decided(found, tested=not shared.undecided)


def _band(log_middle: float, variance: float) -> tuple[float, float, float]:
    half = Z90 * np.sqrt(max(variance, 0.0))
    middle, low, high = (float(np.exp(log_middle + d)) for d in (0.0, -half, half))
    return middle, low, high


def holm(p_values: np.ndarray) -> np.ndarray:
    """Holm's adjusted p-values (n,): the k-th smallest times n - k + 1, none below one that is smaller."""
    order = np.argsort(p_values)
    steps = p_values[order] * (len(p_values) - np.arange(len(p_values)))
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted


def _decided(found: Sequence[Difference], tested: bool = True) -> list[Difference]:
    """Differences of one family; without a standard deviation there is nothing to test, and any difference is one."""
    open_ = [d for d in found if d.log_sd > 0.0]
    p_values = np.array([2.0 * norm.sf(abs(d.log_ratio) / d.log_sd) for d in open_])
    adjusted = dict(zip(map(id, open_), holm(p_values).tolist(), strict=True)) if tested else {}
    # What the first of Holm's steps asks for.
    clear = float(norm.isf(0.5 * ERROR_RATE / max(len(open_), 1)))
    return [
        replace(
            d,
            p_adjusted=adjusted[id(d)],
            changed=adjusted[id(d)] < ERROR_RATE,
            least_seen=float(np.expm1(clear * d.log_sd)),
        )
        if id(d) in adjusted
        else replace(d, changed=tested and abs(d.log_ratio) > 1e-9)
        for d in found
    ]


def _static_loads(
    first: StoredResult, second: StoredResult, shared: SharedErrors
) -> tuple[list[Difference], list[str]]:
    """Static axle loads of load cases with one name: declared, with the errors of their readings."""
    cases = [c for c in first.axle_loads_kg if c in second.axle_loads_kg]
    if not cases or len(first.axles) != len(second.axles):
        names = f"{listing(list(first.axle_loads_kg))}; {listing(list(second.axle_loads_kg))}"
        return [], [f"Static axle loads are not compared: the load cases have no name in common ({names})."]
    found, sides = [], []
    for result, side in ((first, 0), (second, 1)):
        sides.append(_load_quantities(result, cases, [p[side] for p in shared.pairs]))
    mean, covariance = log_differences(*sides)
    places = [(case, axle) for case in cases for axle in range(len(first.axles))]
    for n, (case, axle) in enumerate(places):
        before, after = (_band(q.middle[n], q.covariance[n, n]) for q in sides)
        sd = float(np.sqrt(max(covariance[n, n], 0.0)))
        # One reading of one scale: rounding is no difference.
        sd = 0.0 if sd < 1e-7 else sd
        ratio = 0.0 if abs(mean[n]) < 1e-7 else float(mean[n])
        name = f"load_{axle + 1}[{case}]"
        found.append(
            Difference("static loads", name, "static_axle_load", axle + 1, (case, case), "N", before, after, ratio, sd)
        )
    return _decided(found), []


def _load_quantities(result: StoredResult, cases: Sequence[str], chosen: Sequence[int]) -> _Quantities:
    """Logarithms of static axle loads [N] beside some errors: every load is its reading times its errors."""
    count = len(result.axles)
    declared = np.array([result.axle_loads_kg[case] for case in cases]).ravel() * result.gravity_m_s2
    by_error = np.zeros((declared.size, len(result.errors)))
    for k, error in enumerate(result.errors):
        for n in range(declared.size):
            case, axle = cases[n // count], n % count + 1
            own = error.kind == "axle_load_factor" and (error.place, error.load_case) == (axle, case)
            if own or error.kind == "axle_load_scale_factor":
                by_error[n, k] = error.sd
    middle = np.log(declared) + by_error @ np.array([e.estimate for e in result.errors])
    covariance = by_error @ result.error_covariance @ by_error.T
    if not chosen:
        none = np.zeros(0)
        return _Quantities(middle, covariance, np.zeros((declared.size, 0)), none, np.zeros((0, 0)), none)
    sd, estimate, known, _ = _shared_part(result, chosen)
    together = (by_error @ result.error_covariance)[:, list(chosen)] * sd
    return _Quantities(middle, covariance, np.linalg.solve(known, together.T).T, estimate, known, sd)


def _peaks(first: StoredResult, second: StoredResult) -> tuple[list[Difference], list[str]]:
    """Largest axle loads of passes that both predict, with the intervals of both as if they shared nothing."""
    found, plain = [], False
    others = {_pass(p): p for p in second.peaks}
    several = len({_pass(p)[3:] for p in (*first.peaks, *second.peaks)}) > 1
    for a in first.peaks:
        b = others.get(_pass(a))
        if b is None or not all(p.load_case in r.axle_loads_kg for p, r in ((a, first), (b, second))):
            continue
        bands = [_peak_band(p, r) for p, r in ((a, first), (b, second))]
        if None in bands:
            plain = True
            continue
        before, after = (band for band in bands if band is not None)
        logs = [np.log(band) for band in (before, after)]
        sd = float(np.hypot(*[(log[2] - log[1]) / (2.0 * Z90) for log in logs]))
        where = f", {a.shape['name']}" if several and a.shape else ""
        found.append(
            Difference(
                "peak loads",
                f"peak_{a.axle}[{a.load_case}, {a.speed_km_h:g} km/h{where}]",
                "peak_axle_load",
                a.axle,
                (a.load_case, b.load_case),
                "N",
                before,
                after,
                float(logs[1][0] - logs[0][0]),
                sd,
            )
        )
    said = ["Peak axle loads have no intervals before sampling and are not compared; use 'run'."] if plain else []
    return _decided(found, tested=False), said


def _pass(p: StoredPeak) -> tuple[object, ...]:
    shape = p.shape or {}
    return p.load_case, p.axle, round(p.speed_km_h, 6), shape.get("name"), shape.get("height_m"), shape.get("length_m")


def _peak_band(p: StoredPeak, result: StoredResult) -> tuple[float, float, float] | None:
    ratio, loads = p.peak_dynamic_load_ratio, result.axle_loads_kg[p.load_case]
    ends = (ratio.q50, ratio.q05, ratio.q95)
    if p.axle > len(loads) or any(r is None or r <= 0.0 for r in ends):
        return None
    static = loads[p.axle - 1] * result.gravity_m_s2
    middle, low, high = (static * float(r or 0.0) for r in ends)
    return middle, low, high
