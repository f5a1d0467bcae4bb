"""Results of the least-squares fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.arrays import ParametersByParameters
from sysid.estimation.fit.causes import Cause
from sysid.estimation.parameters.estimate import ParameterEstimate, ParameterEstimates
from sysid.estimation.parameters.rockers import LoadShare
from sysid.estimation.parameters.undeclared_parts import Drive, UndeclaredFrame
from sysid.estimation.residuals.run_history import RunHistory
from sysid.estimation.uncertainty.further_unknowns import FurtherUnknowns
from sysid.estimation.uncertainty.identifiability import Identifiability
from sysid.estimation.uncertainty.part_agreement import PartDifference
from sysid.estimation.weights.residual_evidence import ResidualEvidence
from sysid.tabular import Tabular, records_table
from sysid.wording import finish, nearest, shorten

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class LawTrial:
    """One set of suspension laws that was fitted: `laws` by axle, number of `parameters`, `cost`, `misfit` and `gain`
    in the information criterion over the first trial.

    The cost is half the weighted sum of squares with priors; if several laws were fitted, under the same weights and
    with masses and tires free within their tolerances. The misfit is residual over noise: of the instruments, or of the
    records before the bump if that is larger.
    """

    laws: tuple[str, ...]
    parameters: int
    cost: float
    misfit: float
    gain: float


@dataclass(frozen=True)
class UndecidedLaw:
    """A law element, by its `words`, about which the data do not decide: with `gain` in the criterion it has `weight`.

    `is_chosen` says whether the chosen laws have it. `names` of parameters and the `shift` of their logarithms if the
    choice were the other one.
    """

    words: str
    gain: float
    weight: float
    is_chosen: bool
    names: tuple[str, ...]
    shift: tuple[float, ...]

    @property
    def doubt(self) -> float:
        """Weight of the choice that was not made."""
        return 1.0 - self.weight if self.is_chosen else self.weight

    @property
    def sentence(self) -> str:
        """What is not decided, and what this does to the intervals."""
        return (
            f"The data do not decide on {self.words}, which the calibrated model {'has' if self.is_chosen else 'lacks'}"
            f" (probability {100.0 * self.weight:.0f} %): the intervals include both cases."
        )


@dataclass(frozen=True)
class LawComparison(Tabular):
    """Trials of suspension laws and the one that was `chosen`, by axle; `undecided` elements widen the intervals.

    `untried`: whether elements were added and removed by their expected gain alone, without a trial.
    """

    trials: tuple[LawTrial, ...]
    chosen: tuple[str, ...]
    undecided: tuple[UndecidedLaw, ...] = ()
    untried: bool = False

    def summary(self) -> pd.DataFrame:
        """One row per trial."""
        return records_table(self.trials, ("laws", "parameters", "cost", "misfit", "gain"))


@dataclass(frozen=True)
class ContactTrial:
    """The fit repeated with another contact law: `misfit` residual over noise (as in :class:`LawTrial`), `values` in
    the order of the result's parameters.
    """

    contact: str
    misfit: float
    values: tuple[float, ...]


@dataclass(frozen=True)
class MassCheck:
    """One declared mass property: `words` say which, `tolerance` is the standard deviation of the logarithm of a factor
    on it before the data and `sd` after them, and `estimate` the factor.
    """

    name: str
    quantity: str
    words: str
    tolerance: float
    estimate: float
    sd: float


@dataclass(frozen=True)
class FitResult(Tabular):
    """The least-squares optimum: global parameters, covariance, residual statistics and diagnostics.

    - `covariance` (p, p): of the global parameters in the estimation space (logarithms where `transform` says so), with
      run-local parameters marginalised. It is inflated for residual autocorrelation, for the tolerances of declared
      masses and for model error (a sandwich over blocks of residuals, :mod:`sysid.estimation.uncertainty.sandwich`);
    - `model_error_inflation`: root mean square factor of the allowance for model error on standard deviations;
    - `residual_evidence`: correlation, spectra and tails of the residuals;
    - `step_halving_error`: the largest relative RMS change of any channel when the integration step is halved at the
      optimum;
    - `scipy_max_difference_sd`: the largest difference between the optimum found by SciPy's trust-region solver and
      this one, in standard deviations;
    - `law_comparison`: the laws that were compared, None if none were;
    - `contact_trials`: the fits with every contact law, if requested, beginning with that of the result;
    - `masses`: what the data say about declared masses; `covariance` includes their tolerances;
    - `identifiability`: what the data determine (:mod:`sysid.estimation.uncertainty.identifiability`);
    - `load_shares` of the declared rockers between springs;
    - `undeclared_rockers`, `undeclared_frames` and `undeclared_drive` are what the campaign file does not declare but
      the residuals show (:mod:`sysid.estimation.fit.part_search`): they are part of the model;
    - `doubts` are those `warnings` that make the values doubtful and that none of the other fields says: numerical
      errors, values that contradict what was declared;
    - `causes`: what the records show that the campaign file does not say, by kind;
    - `parts` says of stiffness and damping how far parts of the data disagree;
    - `impossible` are those `warnings` that name values that no truck has
      (:mod:`sysid.estimation.fit.implausible_values`);
    - `further`: errors of declared masses and of the contact model, and how the parameters go with them;
    - `tire_growth` of every axle: how the damping of its tires grows with their contact, as in
      :class:`~sysid.vehicle_model.contact.TireLaw`; empty where it is not known, which counts as 1;
    - `misfit` is the median over channels and runs of residual over noise. The noise is that of the instruments, or
      what the channels show before the bump.
    """

    parameters: ParameterEstimates
    run_parameters: ParameterEstimates
    covariance: ParametersByParameters
    histories: tuple[RunHistory, ...]
    converged: bool
    message: str
    iterations: int
    cost: float
    residuals: int
    condition_number: float
    step_halving_error: float
    scipy_max_difference_sd: float
    variance_inflation: float
    model_error_inflation: float
    contact: str
    residual_evidence: ResidualEvidence
    warnings: tuple[str, ...] = ()
    law_comparison: LawComparison | None = None
    contact_trials: tuple[ContactTrial, ...] = ()
    masses: tuple[MassCheck, ...] = ()
    identifiability: Identifiability | None = None
    load_shares: tuple[LoadShare, ...] = ()
    undeclared_rockers: tuple[LoadShare, ...] = ()
    misfit: float = float("nan")
    undeclared_frames: tuple[UndeclaredFrame, ...] = ()
    undeclared_drive: Drive | None = None
    doubts: tuple[str, ...] = ()
    causes: tuple[Cause, ...] = ()
    impossible: tuple[str, ...] = ()
    parts: tuple[PartDifference, ...] = ()
    further: FurtherUnknowns | None = None
    tire_growth: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("parameters", "run_parameters"):
            object.__setattr__(self, name, ParameterEstimates(getattr(self, name)))

    @property
    def laws(self) -> tuple[str, ...]:
        """Suspension law of every axle (of a group one, in the place of its first axle), front to rear."""
        laws = {p.axle: p.law for p in self.parameters if p.quantity == "damping"}
        return tuple(laws[axle] for axle in sorted(laws, key=lambda a: -1 if a is None else a))

    @property
    def proposals(self) -> tuple[str, ...]:
        """Sentences that ask to declare what the data show."""
        rockers = (r.proposal for r in self.undeclared_rockers)
        drive = () if self.undeclared_drive is None else (self.undeclared_drive.proposal,)
        return (*rockers, *(f.proposal for f in self.undeclared_frames), *drive)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the global parameters in the order of the covariance."""
        return tuple(p.name for p in self.parameters)

    def __getitem__(self, name: str) -> ParameterEstimate:
        """The estimate of a parameter by its name, in SI units: ``fit["k_1"].value``.

        Raises
        ------
        KeyError
            If there is no such parameter; the nearest name is suggested.
        """
        estimates: tuple[ParameterEstimate, ...] = (*self.parameters, *self.run_parameters)
        for p in estimates:
            if p.name == name:
                return p
        raise KeyError(finish(f"the fit has no parameter '{shorten(name)}'; {nearest(name, self.names)}"))

    _in_row_unit = ParameterEstimates._in_row_unit

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return self.parameters.summary()

    def to_pandas(self) -> pd.DataFrame:
        """Global parameters and those of every run."""
        return ParameterEstimates((*self.parameters, *self.run_parameters)).to_pandas()
