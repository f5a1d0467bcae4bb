"""The campaign's residuals as a function of one vector."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property, partial

import numpy as np

from sysid.arrays import Parameters, UnknownsOfFit
from sysid.campaign.records import Campaign
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.by_group import ByGroup, too_many
from sysid.estimation.residuals.compressed import Compressed, compress, run_order
from sysid.estimation.residuals.linearisation import linearise, linearise_one
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RUN_UNKNOWNS, SHIFT, SPEED, RunMotion, motion_prior
from sysid.vehicle_model.engines.protocol import Linearisation


class Problem:
    """Campaign residuals as a function of one vector: global log parameters, then scaled changes of the run motions."""

    def __init__(self, model: BumpModel, campaign: Campaign, motion: RunMotion, weights: Weights):
        self.model, self.reference_motion, self.weights = model, motion, weights
        self.expected = motion_prior(campaign.bump_runs)
        self.order = run_order(model)
        self.count = len(model.parameters.parameters)
        # Checks, covariance and the next round ask for the same point again.
        self._latest: tuple[bytes, Weights, Sequence[Linearisation]] | None = None
        self._small: tuple[bytes, Weights, Compressed] | None = None

    def vector(self, log_parameters: Parameters) -> UnknownsOfFit:
        """The vector of log parameters (p,) and the motions about which the unknowns are measured."""
        return np.concatenate([log_parameters, np.zeros(RUN_UNKNOWNS * len(self.order))])

    def unpack(self, vector: UnknownsOfFit) -> tuple[np.ndarray, RunMotion]:
        """Log parameters and run motions of a vector."""
        moved = np.zeros((self.reference_motion.speed_m_s.size, RUN_UNKNOWNS))
        moved[self.order] = vector[self.count :].reshape(-1, RUN_UNKNOWNS)
        return vector[: self.count], self.reference_motion.moved(moved, self.expected.change_sd)

    def with_weights(self, weights: Weights) -> Problem:
        """The same residuals under other weights."""
        other = copy(self)
        other.weights = weights
        other._latest = other._small = None
        return other

    def forget(self) -> None:
        """Delete the derivatives that are stored for the last point."""
        self._latest = None

    @cached_property
    def by_group(self) -> bool:
        """Whether the derivatives of all groups are too many to be held together."""
        return too_many(self.model, self.count + RUN_UNKNOWNS)

    def linearise(self, vector: UnknownsOfFit) -> Sequence[Linearisation]:
        """Linearisation of every group at a vector, stored until another vector is requested.

        Where they are too many, each is computed whenever it is asked for.
        """
        if self.by_group:
            # Under the weights of now, whatever they are when it is asked for.
            one = partial(linearise_one, self.model, self.weights, *self.unpack(vector))
            return ByGroup(len(self.model.groups), one)
        if not self._is_kept(vector):
            # Two of them at the same time would be the largest memory of a fit.
            self.forget()
            self._latest = vector.tobytes(), self.weights, linearise(self.model, self.weights, *self.unpack(vector))
        assert self._latest is not None
        return self._latest[2]

    def linearise_one(self, vector: UnknownsOfFit, position: int) -> Linearisation:
        """Linearisation of one group, not stored unless all are, because other columns need the memory."""
        if self._is_kept(vector):
            return self.linearise(vector)[position]
        return linearise_one(self.model, self.weights, *self.unpack(vector), position)

    def _is_kept(self, vector: UnknownsOfFit) -> bool:
        latest = self._latest
        return latest is not None and latest[0] == vector.tobytes() and latest[1] is self.weights

    def evaluate(self, vector: UnknownsOfFit) -> tuple[np.ndarray, np.ndarray]:
        """Compressed residuals (m,) and Jacobian (m, p + 3 runs)."""
        problem = self.compressed(vector)
        return problem.residual, problem.jacobian

    def compressed(self, vector: UnknownsOfFit) -> Compressed:
        """Compressed residuals and Jacobian with respect to the vector, stored until another vector is requested."""
        small = self._small
        if small is None or small[0] != vector.tobytes() or small[1] is not self.weights:
            small = self._small = vector.tobytes(), self.weights, self._compressed(vector)
        return small[2]

    def _compressed(self, vector: UnknownsOfFit) -> Compressed:
        parameters, motion = self.unpack(vector)
        problem = compress(self.model, self.linearise(vector), parameters, motion, self.expected)
        # The tangents are in units of the current speed, but the vector is in units of the reference speed.
        jacobian = problem.jacobian.copy()
        here, reference = motion.of(self.order), self.reference_motion.of(self.order)
        jacobian[:, self.count + SPEED :: RUN_UNKNOWNS] /= here.mean_speed_m_s / reference.mean_speed_m_s
        jacobian[:, self.count + SHIFT :: RUN_UNKNOWNS] *= here.speed_m_s / reference.speed_m_s
        return Compressed(problem.residual, jacobian)
