"""What the data say about the parameters with all else integrated out, and what more data would add to it.

Masses and departures y are unknowns with priors N(0, L^-1). H is the information of parameters x and y (with the runs'
own motions eliminated), D that of more data, P the prior precision and C the flattening for model error that no
departure describes. The rows of R are laws that the data do not decide
(:mod:`sysid.estimation.fit.undecided_laws`):

    H' = H + D,    N = H'_xx - H'_xy (H'_yy + L)^-1 H'_yx,    covariance = (((C' N C)^-1 + R'R)^-1 + P)^-1.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.estimation.uncertainty.normal_equations import NormalEquations

#: Kinds of unknowns beside the parameters: readings of a scale, other masses, and departures from the model.
SCALES, MASSES, TIRES = "scale readings", "masses", "tires and friction"


@dataclass(frozen=True)
class DataInformation:
    """Information of the data of a fit about p log parameters, then q masses and departures.

    - `matrix`: H (p + q, p + q);
    - `flattening`: C (p, p), including the effect of footprint maps that follow their tires
      (:mod:`sysid.estimation.uncertainty.map_following`);
    - `prior`: P (p, p), prior precision of the parameters;
    - `sd` (q,): prior standard deviations of masses and departures; the first `masses` of them are masses;
    - `factor`: by how much model error widens all variances; the matrix already includes it;
    - `laws` (k, p): rows whose squares R'R are added to the covariance by the data, for laws that the data do not
      decide and for parts of the data that disagree (:mod:`sysid.estimation.uncertainty.part_agreement`);
    - `kinds` (q,): which masses and departures are scale readings (:data:`SCALES`), other masses or tires.
    """

    matrix: np.ndarray
    flattening: ParametersByParameters
    prior: ParametersByParameters
    sd: np.ndarray
    masses: int
    factor: float = 1.0
    laws: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    kinds: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.kinds:
            others = self.sd.size - self.masses
            object.__setattr__(self, "kinds", (MASSES,) * self.masses + (TIRES,) * others)

    def precision(self, further: np.ndarray | None = None) -> np.ndarray:
        """Precision (p, p) of the parameters by the data alone; `further` (p + q, p + q) that of other data."""
        matrix = self.matrix if further is None else self.matrix + further / self.factor
        adjusted = self._adjusted(matrix)
        adjusted = adjusted @ self._between_laws(adjusted)
        return np.asarray(0.5 * (adjusted + adjusted.T))

    def with_laws(self, laws: np.ndarray | None) -> DataInformation:
        """The same with other rows (k, p) of undecided laws, None for none."""
        return replace(self, laws=np.zeros((0, self.prior.shape[0])) if laws is None else laws)

    def slope(self, gradient: Parameters) -> Parameters:
        """Gradient (p,) of the log-likelihood with undecided laws, from that of the chosen ones."""
        return np.asarray(self._between_laws(self._adjusted(self.matrix)).T @ gradient)

    def _adjusted(self, matrix: np.ndarray) -> ParametersByParameters:
        """C' N C (p, p) from H' (p + q, p + q)."""
        further = slice(len(self.prior), None)
        left = NormalEquations.of(matrix, sd=self.sd).eliminate(further).left.matrix
        return np.asarray(self.flattening.T @ left @ self.flattening)

    def _between_laws(self, precision: ParametersByParameters) -> ParametersByParameters:
        """T (p, p) with (N^-1 + R'R)^-1 = N T for a precision N."""
        rows = self.laws
        if not rows.size:
            return np.eye(precision.shape[0])
        inner = np.eye(len(rows)) + rows @ precision @ rows.T
        return np.asarray(np.eye(precision.shape[0]) - rows.T @ np.linalg.solve(inner, rows @ precision))

    def covariance(self, further: np.ndarray | None = None) -> np.ndarray:
        """Covariance (p, p) of the log parameters, priors included; `further` as in :meth:`precision`."""
        return np.linalg.inv(self.precision(further) + self.prior)
