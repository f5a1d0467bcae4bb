"""Information of the data about parameters, masses and departures from the model, at the optimum of a fit.

Scores and information of all runs, with the runs' own motions eliminated, give the step to the joint optimum, the
factor and flattening for model error that no departure describes (:mod:`sysid.estimation.uncertainty.sandwich`), and
what is left for the parameters (:mod:`sysid.estimation.uncertainty.data_information`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters, UnknownsOfFit
from sysid.campaign.records import Campaign
from sysid.estimation.residuals.by_group import ByGroup, each_group
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.run_clocks import RunClocks, run_clocks
from sysid.estimation.uncertainty.allowance_columns import allowance_columns
from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.data_information import MASSES, SCALES, TIRES, DataInformation
from sysid.estimation.uncertainty.departure_scale import departure_scale, least_sd
from sysid.estimation.uncertainty.integrated_unknowns import (
    ErrorGivenParameters,
    IntegratedUnknowns,
    integrated_unknowns,
)
from sysid.estimation.uncertainty.joint_step import JointStep, bounded_step, joint_step
from sysid.estimation.uncertainty.map_following import footprints_by_tires, map_following
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.part_agreement import Block, PartAgreement, part_agreement
from sysid.estimation.uncertainty.residual_columns import ResidualColumns
from sysid.estimation.uncertainty.run_scores import ClockScores, PriorScores, run_scores
from sysid.estimation.uncertainty.sandwich import BlockScores, adjust

#: Rounds in which the factor of model error, and the scales of departures that go with it, are found.
_FACTOR_ROUNDS = 4


@dataclass(frozen=True)
class ClockFollowing:
    """How the unknown clocks (n, e) of n runs follow p + m other unknowns, all in prior standard deviations.

    `alone` (n, e) is their step while the others stay. `response` (n, e, p + m) says how they follow the others, with
    opposite sign. `sd` (n, e) are their remaining standard deviations.
    """

    alone: np.ndarray
    response: np.ndarray
    sd: np.ndarray

    def step(self, change: np.ndarray) -> np.ndarray:
        """The step (n, e) with a change (p + m,) of the others."""
        return np.asarray(self.alone - self.response @ change)


@dataclass(frozen=True)
class BlockInformation:
    """Scores and information of p parameters and m further unknowns, runs' own motions eliminated.

    - `matrix` (p + m, p + m);
    - `scores` (n, p + m): of single runs and channels, and `blocks`: the block of each (one channel in all repeats of
      one case). The priors of the runs' own motions, which were eliminated, are one more block for each load case;
    - `parts` (n, p + m, p + m): the terms whose sum is the matrix, None unless requested;
    - `of_load_cases`: the share of the matrix that comes from the runs in each load case.

    `clocks`: how the clocks of further loggers follow, if they were eliminated as well.
    """

    matrix: np.ndarray
    scores: np.ndarray
    blocks: tuple[Block, ...]
    parts: np.ndarray | None = None
    clocks: ClockFollowing | None = None
    of_load_cases: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def score(self) -> np.ndarray:
        """Gradient (p + m,) of half the sum of squares of the data."""
        return np.asarray(self.scores.sum(axis=0))

    def by_block(self, values: np.ndarray) -> np.ndarray:
        """Sums over blocks of values (n, ...) of single runs and channels."""
        order = {key: i for i, key in enumerate(dict.fromkeys(self.blocks))}
        sums = np.zeros((len(order), *values.shape[1:]))
        np.add.at(sums, [order[k] for k in self.blocks], values)
        return sums


def apart_by_load_case(data: BlockInformation, known: int) -> tuple[np.ndarray, np.ndarray]:
    """Information and score with an unknown of its own in every load case for each unknown beyond the first `known`.

    They are (known + q L,) square and (known + q L,), the load cases of an unknown next to each other.
    """
    cases = list(data.of_load_cases)
    candidates = data.matrix.shape[0] - known
    matrix = np.zeros((known + candidates * len(cases),) * 2)
    score = np.zeros(matrix.shape[0])
    matrix[:known, :known], score[:known] = data.matrix[:known, :known], data.score[:known]
    load_case_of = np.array([block.load_case for block in data.blocks])
    for number, (case, information) in enumerate(data.of_load_cases.items()):
        at = known + number + len(cases) * np.arange(candidates)
        matrix[:known, at], matrix[at, :known] = information[:known, known:], information[known:, :known]
        matrix[np.ix_(at, at)] = information[known:, known:]
        score[at] = data.scores[load_case_of == case].sum(axis=0)[known:]
    return matrix, score


def optimum_information(
    campaign: Campaign,
    problem: Problem,
    vector: UnknownsOfFit,
    allowances: Allowances,
    amounts: np.ndarray | None,
) -> BlockInformation:
    """Information of the data about parameters, then masses and departures, where these are `amounts` (q,).

    The clocks of further loggers are free within what is known of them.
    """
    parameters, motion = problem.unpack(vector)
    columns = allowance_columns(problem.model, allowances, problem.weights, parameters, motion, amounts)
    return information_with(campaign, problem, vector, *columns, with_parts=True, clocks=run_clocks(campaign))


def information_with(
    campaign: Campaign,
    problem: Problem,
    vector: UnknownsOfFit,
    *kinds: Sequence[ResidualColumns],
    with_parts: bool = False,
    clocks: RunClocks | None = None,
) -> BlockInformation:
    """Information of the data about parameters, then the unknowns of further columns; of single channels on request.

    Parameters
    ----------
    kinds : columns of every group by unknowns of some kind, kind after kind.
    clocks : those of further loggers, eliminated with the motions; None for clocks that stay.
    """
    scores: list[np.ndarray] = []
    parts: list[np.ndarray] = []
    blocks: list[Block] = []
    sensors = problem.model.layout.sensors
    of_cases: dict[str, np.ndarray] = {}
    of_clocks: list[tuple[tuple[int, ...], ClockScores]] = []

    def of_group(position: int) -> tuple[BlockScores, PriorScores, ClockScores | None]:
        return run_scores(problem, vector, position, [of_kind[position] for of_kind in kinds], with_parts, clocks)

    groups = problem.model.groups
    in_turn = problem.by_group or any(isinstance(of_kind, ByGroup) for of_kind in kinds)
    each = each_group(of_group, len(groups)) if in_turn else map(of_group, range(len(groups)))
    for group, (scored, by_priors, by_clocks) in zip(groups, each, strict=True):
        if by_clocks is not None:
            of_clocks.append((group.runs, by_clocks))
        parts += scored.parts
        measured = np.asarray(group.measured.any(axis=0))
        for run, used, of_run, information in zip(group.runs, measured, scored.scores, scored.information, strict=True):
            record = campaign.bump_runs[run]
            of_cases[record.load_case] = of_cases.get(record.load_case, 0.0) + information
            case = Block(record.load_case, record.case, record.bump, record.nominal_speed_m_s)
            scores += [of_run[c] for c in np.flatnonzero(used)]
            blocks += [replace(case, channel=int(c), sensor=sensors[c].kind) for c in np.flatnonzero(used)]
        scores += list(by_priors.score)
        parts += list(by_priors.information) if with_parts else []
        blocks += [Block(campaign.bump_runs[run].load_case) for run in group.runs]
    matrix = np.sum(list(of_cases.values()), axis=0)
    return BlockInformation(
        matrix,
        np.array(scores),
        tuple(blocks),
        np.array(parts) if with_parts else None,
        None if clocks is None else _in_order(clocks, of_clocks, matrix.shape[0]),
        of_cases,
    )


def _in_order(clocks: RunClocks, of_clocks: Sequence[tuple[Sequence[int], ClockScores]], shared: int) -> ClockFollowing:
    """How clocks follow, in the order of the campaign's runs; those of runs left out do not."""
    size = len(clocks.sd), clocks.count
    alone, response, sd = np.zeros(size), np.zeros((*size, shared)), np.ones(size)
    for runs, scored in of_clocks:
        alone[list(runs)], response[list(runs)], sd[list(runs)] = scored.alone, scored.response, scored.sd
    return ClockFollowing(alone, response, sd)


@dataclass(frozen=True)
class AdjustedInformation:
    """What the data say at a joint optimum of p parameters and q masses and departures.

    - `information` (p, p): of the parameters, with masses and departures integrated out and model error allowed for;
    - `integrated`: what the posterior density integrates out;
    - `inflation` (p,): of variances by model error, in the directions of the sandwich;
    - `slope` (p,): gradient of the log-likelihood with all that integrated out, at the optimum;
    - `data`: for computing what more data would add;
    - `response`: of masses and departures to the parameters;
    - `parts`: whether parts of the data agree;
    - `mode` (q,): masses and departures at the optimum of the equations above, with the scales of departures found
      here. Where a scale is next to nothing, the fit ends before it.
    """

    information: ParametersByParameters
    integrated: IntegratedUnknowns
    inflation: Parameters
    slope: Parameters
    data: DataInformation
    response: MassResponse
    parts: PartAgreement
    mode: np.ndarray


def adjusted_information(
    campaign: Campaign,
    problem: Problem,
    vector: UnknownsOfFit,
    allowances: Allowances,
    amounts: np.ndarray | None = None,
    laws: np.ndarray | None = None,
) -> AdjustedInformation:
    """Masses and departures integrated out, and the sandwich over blocks (one channel in all repeats of one case).

    It speaks of an optimum whose footprint maps follow its tires (:mod:`sysid.estimation.uncertainty.map_following`).

    Parameters
    ----------
    amounts : (q,) masses and departures at the optimum, None for 0.
    laws : rows (k, p) of undecided laws, None for none.
    """
    masses, departures = allowances.masses, allowances.departures
    count, here = problem.count, np.zeros(allowances.count) if amounts is None else amounts
    parameters, _ = problem.unpack(vector)
    # At the optimum the data pull as hard as the priors, the other way.
    pull, prior = problem.model.parameters.prior_pull(parameters)
    data = optimum_information(campaign, problem, vector, allowances, amounts)
    spread = model_error(data, prior, pull, allowances, here, footprints_following(problem, parameters, allowances))
    factor, sd = spread.factor, spread.sd
    matrix = data.matrix / factor
    equations, further = NormalEquations.of(matrix, sd=sd), slice(count, None)
    left, followed = equations.eliminate(further)
    scores = (spread.scores[:, :count] + spread.scores[:, count:] @ followed) / factor
    of_blocks = adjust(scores, range(len(scores)), left.matrix)
    follow = np.eye(count)
    if problem.model.tires is not None and departures.directions:
        about = _about_maps(matrix, count, masses.sd.size, sd)
        loads = _footprints_by_loads(allowances) @ followed[: masses.sd.size]
        follow = map_following(about, problem.model.parameters, parameters, departures.directions, loads)
    flat = of_blocks.matrix @ follow
    parts = part_agreement(
        problem.model.parameters.parameters,
        tuple(dict.fromkeys(data.blocks)),
        spread.scores / factor,
        data.by_block(_parts(data)) / factor,
        prior,
        # What all data push against the end of its range would be there with a part of them too.
        np.where(spread.held, 0.0, sd),
    )
    undecided = parts.rows if laws is None else np.concatenate([laws, parts.rows])
    known = DataInformation(matrix, flat, prior, sd, masses.sd.size, factor, undecided, _kinds(allowances))
    slope = follow.T @ of_blocks.matrix.T @ of_blocks.matrix.T @ pull / factor
    slope = known.slope(slope)
    # Model error acts on the parameters that are simulated, undecided laws and parts on those that are reported.
    effects = np.concatenate([of_blocks.effects, follow @ undecided.T], axis=1)
    error = ErrorGivenParameters.of(effects, left.matrix)
    # Masses and departures follow the truck that the data show, which model error moves from the reported one.
    shown = follow + effects @ error.response @ follow
    spread_of = np.concatenate([equations.only(further).covariance_factor, followed @ effects @ error.factor], axis=1)
    response = MassResponse(parameters, followed @ shown, spread_of, here)
    # Data push some against the end of their range.  A normal distribution knows no end: it is to lie about it, not far
    # beyond, and take the parameters along.
    at_rest = np.where(spread.held, -(sd**2) * data.score[count:] / factor, here)
    integrated = integrated_unknowns(matrix, prior, effects, sd, at_rest, factor, follow)
    inflation = factor * of_blocks.inflation
    mode = here + spread.step.amounts
    return AdjustedInformation(known.precision(), integrated, inflation, slope, known, response, parts, mode)


def _parts(data: BlockInformation) -> np.ndarray:
    assert data.parts is not None
    return data.parts


@dataclass(frozen=True)
class ModelError:
    """How much more the data scatter about the joint optimum of p parameters and q masses and departures than noise.

    `factor` on all variances, at least 1; `sd` (q,) prior standard deviations of masses and departures under it; `step`
    to the joint optimum, in which those of `held` (q,) stay at the end of their range; `scores` (b, p + q) of blocks
    there.
    """

    factor: float
    sd: np.ndarray
    step: JointStep
    held: np.ndarray
    scores: np.ndarray


def model_error(
    data: BlockInformation,
    prior: ParametersByParameters,
    pull: Parameters,
    allowances: Allowances,
    amounts: np.ndarray,
    footprint_response: np.ndarray | None = None,
) -> ModelError:
    """By how much model error widens all variances.

    g_b are the scores of blocks at the joint optimum, H_b the information in them, and Z the joint covariance. If the
    model were right, the scores would scatter by H_b - H_b Z H_b; the second term is what the unknowns absorb:

        factor = sum g_b' Z g_b / sum (tr Z H_b - tr Z H_b Z H_b)

    Parameters
    ----------
    data : with the parts of all blocks, at `amounts` (q,).
    prior : (p, p) P; pull : (p,) gradient of half the sum of squares of the priors.
    footprint_response : (p + q, p + q) of :func:`footprints_following`, None where footprints stay.
    """
    masses, directions = allowances.masses, allowances.departures.directions
    count, factor = prior.shape[0], 1.0
    scores, parts = data.by_block(data.scores), data.by_block(_parts(data))
    for _ in range(_FACTOR_ROUNDS):
        matrix, score = data.matrix / factor, data.score / factor
        with_priors = score.copy()
        with_priors[:count] += pull
        departed = departure_scale(
            matrix, with_priors, prior, masses.sd, directions, amounts, masses.readings, masses.scales
        )
        sd = np.concatenate([departed.mass_sd, departed.sd])
        # What cannot move on, as friction that would push, must not carry the others along.
        step = bounded_step(
            partial(
                joint_step,
                matrix,
                score,
                prior,
                pull,
                amounts=amounts,
                footprint_response=footprint_response,
                least_sd=least_sd(masses.sd.size, directions),
            ),
            sd,
            partial(_held, allowances, amounts),
        )
        change = np.concatenate([step.parameters, step.amounts])
        at_optimum = scores + parts @ (change if footprint_response is None else change + footprint_response @ change)
        covariance = NormalEquations.of(matrix, prior=prior, sd=sd).covariance
        absorbed = covariance @ parts / factor
        scatter = np.sum(at_optimum @ covariance * at_optimum) / factor
        expected = np.einsum("bii->", absorbed) - np.einsum("bij,bji->", absorbed, absorbed)
        factor = max(1.0, float(scatter / max(expected, 1e-12)))
    return ModelError(factor, sd, step, (step.amounts == 0.0) & (sd > 0.0), at_optimum)


def _held(allowances: Allowances, amounts: np.ndarray, step: JointStep) -> np.ndarray:
    """Which masses and departures (q,) are at the end of their reach, and would go beyond."""
    if not amounts.size:
        return np.zeros(0, bool)
    there = allowances.within_reach(amounts + step.amounts)
    return np.asarray((there == amounts) & (step.amounts != 0.0))


def footprints_following(problem: Problem, log_parameters: Parameters, allowances: Allowances) -> np.ndarray | None:
    """F (p + q, p + q): departures to which footprints that follow amount, per parameter, mass and departure.

    None where footprints do not follow tires: none are tabulated for them.
    """
    model, directions = problem.model, allowances.departures.directions
    if model.tires is None or not directions:
        return None
    count, masses = problem.count, allowances.masses.sd.size
    footprint_response = np.zeros((count + allowances.count,) * 2)
    footprint_response[count + masses :, :count] = footprints_by_tires(model.parameters, log_parameters, directions)
    footprint_response[count + masses :, count : count + masses] = _footprints_by_loads(allowances)
    return footprint_response


def _kinds(allowances: Allowances) -> tuple[str, ...]:
    """What each mass or departure is, for :class:`DataInformation`."""
    masses = allowances.masses
    of_masses = [SCALES if s else MASSES for s in masses.readings | masses.scales]
    return (*of_masses, *[TIRES] * len(allowances.departures.directions))


def _footprints_by_loads(allowances: Allowances) -> np.ndarray:
    """Departures (n, m) to which footprints that follow the axle loads amount, per log factor on a mass."""
    masses = allowances.masses
    small = 1e-3 * masses.sd
    by_factor = [
        allowances.departures.footprints_by_loads(partial(masses.load_changes, unit)) / size
        for unit, size in zip(np.diag(small), small, strict=True)
    ]
    shape = (masses.sd.size, len(allowances.departures.directions))
    return np.asarray(np.array(by_factor).reshape(shape).T)


def _about_maps(matrix: np.ndarray, count: int, masses: int, sd: np.ndarray) -> np.ndarray:
    """Information (p + n, p + n) of parameters and of what moves footprint maps, masses and departures integrated out.

    Maps that follow a tire move as departures of the footprint do, which are free to take that back.
    """
    size = len(matrix)
    twice = [*range(size), *range(count, size)]
    free = NormalEquations.of(matrix[np.ix_(twice, twice)], sd=sd).eliminate(slice(size, None)).left.matrix
    chosen = [*range(count), *range(count + masses, size)]
    return np.asarray(free[np.ix_(chosen, chosen)])
