"""What the data determine, in words: singular values of the scaled Jacobian, open combinations, correlated pairs.

Columns of the Jacobian are in units of prior standard deviations, with the runs' own unknowns eliminated. So the
singular values s solve A v = s^2 P v, where A is the precision of the data and P that of the priors. A combination with
s = 1 is known from the data as well as from the priors; the data reduce the standard deviation of its prior by 1 /
sqrt(1 + s^2). Combinations that they do not reduce below :data:`IDENTIFIED_SHRINKAGE` are undetermined (D. A. Belsley,
E. Kuh and R. E. Welsch, Regression diagnostics, Wiley, 1980, chapter 3, doi:10.1002/0471725153, look for them in the
same way).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from sysid.arrays import Parameters, ParametersByParameters
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.estimation.uncertainty.interval_shares import SOURCES, interval_shares, share_sentences
from sysid.tabular import Tabular
from sysid.wording import joined_words

if TYPE_CHECKING:
    import pandas as pd

#: The data determine a parameter or a combination if they reduce its prior's standard deviation at least by this
#: factor.
IDENTIFIED_SHRINKAGE = 0.7
#: Correlation from which on two parameters are hard to tell apart.
CORRELATED = 0.9
#: Relative standard deviation from which on a stiffness or damping is known only roughly.
ROUGH = 0.1
#: Element of the projector on undetermined combinations from which on two parameters belong to one of them.
_LINKED = 0.2
#: Coefficients of a combination that differ by less than this factor count as equal.
_ALIKE = 1.5


@dataclass(frozen=True)
class CorrelatedPair:
    """Two parameters that are hard to separate by the data: `correlation` of their logarithms."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True)
class UndeterminedGroup:
    """Parameters that the data do not determine singly: of their `names` only `known` combinations are determined.

    `kind` is ``sum`` or ``ratio`` where the one known combination is that, ``combination`` for others, and ``none``
    where none is known; `relative_sd` of a sum or ratio, else NaN.
    """

    names: tuple[str, ...]
    known: int
    kind: str
    relative_sd: float


@dataclass(frozen=True)
class Identifiability(Tabular):
    """What the data determine of p parameters.

    - `prior_sd`, `sd` (p,): standard deviations of the logarithms before and after the data;
    - `singular_values` (p,): of the Jacobian in units of prior standard deviations, largest first;
    - `groups`: parameters that the data do not determine singly, and `pairs`: correlated ones;
    - `statements`: the same in words;
    - `information`: for computing what more data would add.

    `shares` (p, n) of the n sources of uncertainty in the variance of every logarithm
    (:mod:`sysid.estimation.uncertainty.interval_shares`).
    """

    names: tuple[str, ...]
    prior_sd: Parameters
    sd: Parameters
    singular_values: Parameters
    groups: tuple[UndeterminedGroup, ...]
    pairs: tuple[CorrelatedPair, ...]
    statements: tuple[str, ...]
    information: DataInformation
    shares: np.ndarray

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources of uncertainty, in the order of the shares."""
        return SOURCES

    @property
    def share_sentences(self) -> tuple[str, ...]:
        """Which sources make most of the variance of k and c, and what would lower them."""
        return share_sentences(self.names, self.shares)

    @property
    def shrinkage(self) -> np.ndarray:
        """Standard deviation after the data over that before, (p,)."""
        return np.asarray(self.sd / self.prior_sd)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about suspension parameters that the data do not determine."""
        return group_statements([g for g in self.groups if not all(is_tire(name) for name in g.names)])

    @property
    def determined(self) -> int:
        """Number of combinations that the data determine."""
        return int((self.singular_values > _least_singular_value()).sum())

    def summary(self) -> pd.DataFrame:
        """One row per parameter."""
        import pandas as pd

        columns = {"name": self.names, "prior_sd": self.prior_sd, "sd": self.sd, "shrinkage": self.shrinkage}
        by_source = {f"share of {source}": self.shares[:, k] for k, source in enumerate(SOURCES)}
        return pd.DataFrame(columns | by_source)


def _least_singular_value() -> float:
    return float(np.sqrt(IDENTIFIED_SHRINKAGE**-2.0 - 1.0))


def assess(
    estimates: Sequence[ParameterEstimate], covariance: ParametersByParameters, information: DataInformation
) -> Identifiability:
    """What the data determine of the parameters of a fit.

    Parameters
    ----------
    estimates : the p global parameters; covariance : (p, p) of their logarithms.
    information : of the data.
    """
    names = tuple(p.name for p in estimates)
    values = np.array([p.value for p in estimates])
    prior_sd = np.sqrt(np.diag(np.linalg.inv(information.prior)))
    squares, vectors = eigh(information.precision(), information.prior)
    singular = np.sqrt(np.maximum(squares, 0.0))
    open_ = vectors[:, singular <= _least_singular_value()] / prior_sd[:, None]
    groups = _groups(names, [p.unit for p in estimates], values, prior_sd, open_, covariance)
    pairs = correlated_pairs(names, covariance)
    by_name = {p.name: p for p in estimates}
    return Identifiability(
        names,
        prior_sd,
        np.sqrt(np.diag(covariance)),
        singular[::-1],
        groups,
        pairs,
        (*group_statements(groups), *rough_statements(estimates, groups), *pair_statements(by_name, groups, pairs)),
        information,
        interval_shares(information),
    )


def correlated_pairs(
    names: Sequence[str], covariance: ParametersByParameters, limit: float = CORRELATED
) -> tuple[CorrelatedPair, ...]:
    """Pairs of at least the correlation `limit`, strongest first; covariance (p, p)."""
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    first, second = np.nonzero(np.triu(np.abs(correlation) >= limit, 1))
    order = np.argsort(-np.abs(correlation[first, second]), kind="stable")
    return tuple(
        CorrelatedPair(names[first[k]], names[second[k]], float(correlation[first[k], second[k]])) for k in order
    )


def _groups(
    names: Sequence[str],
    units: Sequence[str],
    values: Parameters,
    prior_sd: Parameters,
    open_: np.ndarray,
    covariance: ParametersByParameters,
) -> tuple[UndeterminedGroup, ...]:
    """Groups of parameters that share undetermined combinations `open_` (p, n), in units of prior sd."""
    if open_.shape[1] == 0:
        return ()
    basis, _ = np.linalg.qr(open_)
    projector = basis @ basis.T
    left = [i for i in range(len(names)) if projector[i].max() >= _LINKED or projector[i].min() <= -_LINKED]
    groups = []
    while left:
        members, queue = [], [left[0]]
        while queue:
            i = queue.pop()
            if i in left:
                left.remove(i)
                members.append(i)
                queue += [j for j in left if abs(projector[i, j]) >= _LINKED]
        groups.append(_group(sorted(members), names, units, values, prior_sd, projector, covariance))
    return tuple(groups)


def _group(
    members: list[int],
    names: Sequence[str],
    units: Sequence[str],
    values: Parameters,
    prior_sd: Parameters,
    projector: ParametersByParameters,
    covariance: ParametersByParameters,
) -> UndeterminedGroup:
    block = projector[np.ix_(members, members)]
    known = len(members) - round(float(np.trace(block)))
    kind, sd = "combination" if known > 0 else "none", float("nan")
    if known == 1:
        # The determined direction, as coefficients of small relative changes.
        slopes = np.linalg.eigh(block)[1][:, 0] / prior_sd[members]
        value = values[members]
        inside = covariance[np.ix_(members, members)]
        if len({units[i] for i in members}) == 1 and _alike(slopes / value):
            kind, weights = "sum", value / value.sum()
        elif len(members) == 2 and _alike(slopes * [1.0, -1.0]):
            kind, weights = "ratio", np.array([1.0, -1.0])
        if kind != "combination":
            sd = float(np.sqrt(weights @ inside @ weights))
    return UndeterminedGroup(tuple(names[i] for i in members), known, kind, sd)


def _alike(coefficients: np.ndarray) -> bool:
    """Whether coefficients have one sign and about one size."""
    low, high = np.abs(coefficients).min(), np.abs(coefficients).max()
    return bool((np.sign(coefficients) == np.sign(coefficients[0])).all() and high <= _ALIKE * low)


def group_statements(groups: Sequence[UndeterminedGroup]) -> tuple[str, ...]:
    """Sentences about what the data do not determine."""
    sentences = []
    alone = [name for g in groups if g.known == 0 for name in g.names]
    if alone:
        sentences.append(f"The data do not determine {joined_words(alone)}: nothing is known there beyond the prior.")
    for g in groups:
        if g.kind in ("sum", "ratio"):
            sentences.append(
                f"{joined_words(g.names)} are only known as a {g.kind} from these sensors and runs "
                f"({g.kind} \N{PLUS-MINUS SIGN} {100.0 * g.relative_sd:.2g} %), not each of them."
            )
        elif g.known > 0:
            what = "one combination" if g.known == 1 else f"{g.known} combinations"
            sentences.append(
                f"These sensors and runs determine only {what} of {joined_words(g.names)}, not each of them."
            )
    return tuple(sentences)


def rough_statements(estimates: Sequence[ParameterEstimate], groups: Sequence[UndeterminedGroup]) -> tuple[str, ...]:
    """A sentence about stiffness and damping that are determined, but only roughly."""
    said = {name for g in groups for name in g.names}
    rough = [p for p in estimates if p.quantity in ("stiffness", "damping") and p.sd >= ROUGH * p.value]
    named = [f"{p.name} (\N{PLUS-MINUS SIGN} {100.0 * p.sd / p.value:.2g} %)" for p in rough if p.name not in said]
    return (f"Known only roughly: {joined_words(named)}.",) if named else ()


def pair_statements(
    by_name: Mapping[str, ParameterEstimate], groups: Sequence[UndeterminedGroup], pairs: Sequence[CorrelatedPair]
) -> tuple[str, ...]:
    """Sentences about suspension parameters that are determined, but hard to separate."""
    sentences = []
    said = {name for g in groups for name in g.names}
    for pair in pairs:
        both = (by_name[pair.first], by_name[pair.second])
        if said & {pair.first, pair.second} or any(is_tire(p.name) for p in both):
            continue
        how = "both larger or both smaller" if pair.correlation > 0 else "more of one and less of the other"
        known = " and ".join(f"{100.0 * p.sd / p.value:.2g} %" for p in both)
        sentences.append(
            f"{pair.first} and {pair.second} are hard to tell apart: {how} fits almost as well (correlation "
            f"{pair.correlation:+.2f}; known to {known})."
        )
    return tuple(sentences)


def is_tire(name: str) -> bool:
    """Whether a parameter of this name belongs to tires, whose values are not results."""
    return name.startswith(("kt_", "ct_", "tire_"))
