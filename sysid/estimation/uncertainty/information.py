"""What the data say about parameters and masses, and what more data would add to it.

The information H of parameters and mass factors (runs' own motions eliminated) is kept apart from what makes
the covariance honest: the flattening C_0 for model error and departures from the model, and the tolerances Sigma of
masses.  With more data of information D, H' = H + D,

    A = C_0' H'_xx C_0,    K = -H'_xx^-1 H'_xm,    covariance = ((A^-1 + K Sigma K')^-1 + P)^-1,

P the prior precision: noise and model error average out as they did before, wrong masses stay wrong.  With D = 0 this
is the covariance of the fit.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.arrays import Masses, ParametersByParameters, UnknownsOfFit
from sysid.campaign.records import Campaign
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departure_scale import departure_columns, departure_scale
from sysid.estimation.uncertainty.map_following import map_following
from sysid.estimation.uncertainty.mass_effect import MassEffect, mass_columns, mass_effect, shift_by_masses
from sysid.estimation.uncertainty.residual_columns import ResidualColumns, joined, with_columns
from sysid.estimation.uncertainty.sandwich import Adjustment, adjust, block_scores


@dataclass(frozen=True)
class DataInformation:
    """Information of the data of a fit about p log parameters and m log mass factors.

    `matrix` H (p + m, p + m); `flattening` C_0 (p, p); `prior` P (p, p) prior precision of the parameters; `mass_sd`
    (m,) tolerances; `map_following` D (p, p) of :mod:`sysid.estimation.uncertainty.map_following`, None for the unit
    matrix.
    """

    matrix: np.ndarray
    flattening: ParametersByParameters
    prior: ParametersByParameters
    mass_sd: Masses
    map_following: ParametersByParameters | None = None

    def precision(self, more: np.ndarray | None = None) -> np.ndarray:
        """Precision (p, p) of the parameters by the data alone; `more` (p + m, p + m) is the information of others."""
        matrix = self.matrix if more is None else self.matrix + more
        count = self.prior.shape[0]
        follow = np.eye(count) if self.map_following is None else self.map_following
        flattening = self.flattening @ follow
        adjusted = flattening.T @ matrix[:count, :count] @ flattening
        if self.mass_sd.size:
            moved = np.linalg.solve(follow, shift_by_masses(matrix, count))
            carried = adjusted @ moved
            # (A^-1 + K Sigma K')^-1 by the Woodbury identity, which needs no inverse of A.
            adjusted = adjusted - carried @ np.linalg.solve(np.diag(self.mass_sd**-2.0) + moved.T @ carried, carried.T)
        return np.asarray(0.5 * (adjusted + adjusted.T))

    def covariance(self, more: np.ndarray | None = None) -> np.ndarray:
        """Covariance (p, p) of the log parameters, priors included; `more` as in :meth:`precision`."""
        return np.linalg.inv(self.precision(more) + self.prior)


@dataclass(frozen=True)
class BlockInformation:
    """Scores and information of p parameters and m further unknowns, runs' own motions eliminated.

    `matrix` (p + m, p + m); `scores` (n, p + m) of single runs and channels, and for each the block it belongs to
    (`blocks`: one channel in all repeats of one case).
    """

    matrix: np.ndarray
    scores: np.ndarray
    blocks: tuple[Hashable, ...]

    @property
    def score(self) -> np.ndarray:
        """Gradient (p + m,) of half the sum of squares of the data."""
        return np.asarray(self.scores.sum(axis=0))


def allowance_columns(problem: Problem, vector: UnknownsOfFit, allowances: Allowances) -> tuple[ResidualColumns, ...]:
    """Derivatives of every group's residuals by masses, then departures."""
    parameters, motion = problem.unpack(vector)
    by_masses = mass_columns(problem.model, allowances.masses, problem.weights, parameters, motion)
    departed = departure_columns(problem.model, allowances.departures, problem.weights, parameters, motion)
    return joined(by_masses, departed)


def information_with(
    campaign: Campaign, problem: Problem, vector: UnknownsOfFit, columns: Sequence[ResidualColumns]
) -> BlockInformation:
    """Information of the data about parameters, then the unknowns of further columns."""
    _, motion = problem.unpack(vector)
    scores: list[np.ndarray] = []
    blocks: list[Hashable] = []
    shared = problem.count + columns[0].gain.shape[-1]
    information = np.zeros((shared, shared))
    for group, of_group, more in zip(problem.model.groups, problem.linearise(vector), columns, strict=True):
        # One group at a time: joined columns of all of them fill the memory of a small computer.
        (lin,) = with_columns([of_group], [more])
        runs = list(group.runs)
        prior = problem.expected.precision(motion, runs)
        run_scores, data = block_scores(
            np.asarray(lin.residual),
            np.asarray(lin.residual_jacobian),
            np.asarray(lin.gain_residual),
            np.asarray(lin.gain_jacobian),
            prior,
        )
        information += data.sum(axis=0)
        for r, run in enumerate(runs):
            record = campaign.bump_runs[run]
            case = (record.case, record.load_case, record.bump, record.nominal_speed_m_s)
            used = group.measured[:, r].any(axis=0)
            scores += [run_scores[r, c] for c in np.flatnonzero(used)]
            blocks += [(*case, int(c)) for c in np.flatnonzero(used)]
    return BlockInformation(information, np.array(scores), tuple(blocks))


def adjusted_information(
    campaign: Campaign, problem: Problem, vector: UnknownsOfFit, allowances: Allowances
) -> tuple[Adjustment, MassEffect, DataInformation]:
    """Sandwich over blocks (one channel in all repeats of one case) and over tolerances of masses, and its parts.

    Both speak of an optimum whose footprint maps follow its tires (:func:`sysid.estimation.uncertainty.map_following`).
    """
    masses, departures = allowances.masses, allowances.departures
    count = problem.count
    data = information_with(campaign, problem, vector, allowance_columns(problem, vector, allowances))
    information, score, scores = data.matrix, data.score, data.scores
    shared = information.shape[0]
    parameters, _ = problem.unpack(vector)
    rows, _ = problem.model.parameters.prior_rows()
    prior_precision, mass_sd = rows.T @ rows, masses.sd
    scale = departure_scale(information, score, prior_precision, mass_sd, departures.directions)
    effect = mass_effect(information, score, prior_precision, np.concatenate([mass_sd, scale.sd]))
    parameter_scores, by_parameters = scores[:, :count], information[:count, :count]
    adjustment = adjust(parameter_scores, data.blocks, by_parameters, effect.scatter)
    follow = np.eye(count)
    if problem.model.tires is not None and departures.directions:
        chosen = [*range(count), *range(count + mass_sd.size, shared)]
        follow = map_following(
            information[np.ix_(chosen, chosen)], problem.model.parameters, parameters, departures.directions
        )
        adjustment = adjustment.after(follow, by_parameters)
        effect = replace(effect, by_data=np.linalg.solve(follow, effect.by_data))
    with_masses = count + mass_sd.size
    cross = information[:count, count:with_masses] * mass_sd
    blocks = adjust(parameter_scores, data.blocks, by_parameters, effect.scatter - cross @ cross.T).matrix
    kept = information[:with_masses, :with_masses]
    return adjustment, effect, DataInformation(kept, blocks, prior_precision, mass_sd, follow)
