"""Everything the finished stages hand to the exports and to the report, in one frozen container."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from sysid.campaign.findings import QualityReport
from sysid.campaign.records import Campaign
from sysid.estimation.fit.causes import CauseKind
from sysid.results.parameter_table import parameter_table
from sysid.road.road_profile import ScanAnalysis
from sysid.sdof.drop_results import DropSummary
from sysid.tabular import Tabular

# For annotations only: at run time these packages would load JAX, which exports and report do without.
if TYPE_CHECKING:
    import pandas as pd

    from sysid.balance.records import ForceBalance
    from sysid.estimates.records import Estimates
    from sysid.estimates.suspension_values import AxleEstimates, Quantity
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.fit.profiles import ProfileLikelihood
    from sysid.estimation.parameters.rockers import LoadShare
    from sysid.planning.advice_records import Advice
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.prediction.predicted_passes import Predictions
    from sysid.prediction.trust import DrivenRange
    from sysid.validation.channel_agreement import Validation

Status = Literal["converged", "not_converged", "preview"]
STATUSES: tuple[Status, ...] = ("converged", "not_converged", "preview")
#: Whether k and c may be used: as they are, within the limits that the reasons name, not as far as their intervals go,
#: or not yet.
Trust = Literal["use", "use_within", "do_not_bet", "not_yet"]
#: What a reason for a verdict is about.
ReasonKind = Literal[
    "preview",
    "not_converged",
    "no_fit",
    "parts_disagree",
    "balance_disagrees",
    "unexplained",
    "impossible_value",
    "sampler",
    "undetermined",
    "wide",
    "undeclared_part",
    "doubtful_input",
    "not_sampled",
    "none",
    CauseKind,
]
#: Those with which nobody should rely on the numbers and their intervals.
FORBIDDING: tuple[Trust, ...] = ("do_not_bet", "not_yet")


@dataclass(frozen=True)
class Judgement:
    """What everything that is written says of the results.

    - `trust` in k and c, the `reasons` for it in sentences, and the kind of each, `kinds`;
    - `notes`: what else to know, such as passes beyond the driven runs; it says nothing against k and c.
    """

    trust: Trust
    reasons: tuple[str, ...]
    kinds: tuple[ReasonKind, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def forbids(self) -> bool:
        """Whether nobody should rely on the numbers and their intervals."""
        return self.trust in FORBIDDING

    @property
    def remark(self) -> str:
        """The verdict in a sentence for comments of files that hold numbers for other programs."""
        return f"Verdict: {self.trust} (trust and reasons: verdict in result.json)."


@dataclass(frozen=True)
class Results(Tabular):
    """Results of all stages that have run; a stage that has not run yet is None (no scans: an empty mapping).

    - `scans` maps the name of a bump to its analysis;
    - `balance` is the force balance, which knows no road;
    - `estimates` holds what drops, fit and posterior say of the truck, `driven` what the driven runs reached;
    - `further` holds results of stages without a field here, by name;
    - `unfinished` names stages that are still running or were stopped, and whose result is what they have got so far;
    - `judgement` says whether the numbers may be used, None where nobody has judged them.

    `provenance` may hold ``input_sha256`` (file -> hash), ``versions`` (package -> version), ``seed``, ``settings``
    (nested mapping), ``timings`` (stage -> seconds) and ``date`` of the last stage (ISO 8601).

    Raises ValueError if `status` is none of ``converged``, ``not_converged``, ``preview``.
    """

    campaign: Campaign
    quality: QualityReport | None = None
    drops: DropSummary | None = None
    balance: ForceBalance | None = None
    scans: Mapping[str, ScanAnalysis] = field(default_factory=dict)
    fit: FitResult | None = None
    posterior: Posterior | None = None
    estimates: Estimates | None = None
    driven: DrivenRange | None = None
    predictions: Predictions | None = None
    validation: Validation | None = None
    advice: Advice | None = None
    profiles: tuple[ProfileLikelihood, ...] = ()
    further: Mapping[str, object] = field(default_factory=dict)
    unfinished: tuple[str, ...] = ()
    status: Status = "not_converged"
    warnings: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    judgement: Judgement | None = None

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise ValueError(f"status is {self.status!r}; expected one of {', '.join(STATUSES)}")

    _in_row_unit = (
        *("least_squares_value", "least_squares_sd", "posterior_mean", "posterior_sd"),
        *("posterior_q05", "posterior_q50", "posterior_q95"),
    )

    def summary(self) -> pd.DataFrame:
        """One row per parameter: least squares and posterior, the columns of parameters.csv."""
        import io

        import pandas as pd

        text = parameter_table(self.campaign.vehicle.axles, self.fit, self.posterior, self.trust)
        return pd.read_csv(io.StringIO(text))

    def suspension(self, quantity: Quantity) -> tuple[AxleEstimates, ...]:
        """Estimates of stiffness or damping of every axle, front to rear; none before any stage has estimated them."""
        return () if self.estimates is None else self.estimates.suspension(quantity)

    @property
    def all_warnings(self) -> tuple[str, ...]:
        """Warnings of the run, the fit and the predicted passes, each once, in this order."""
        sentences = list(self.warnings)
        if self.fit is not None:
            sentences += self.fit.warnings
        if self.predictions is not None:
            sentences += [w for p in self.predictions.passes for w in p.warnings]
        return tuple(dict.fromkeys(sentences))

    @property
    def trust(self) -> Trust | None:
        """What the judgement comes to, None without one."""
        return None if self.judgement is None else self.judgement.trust

    @property
    def load_shares(self) -> tuple[LoadShare, ...]:
        """Load shares of declared rockers: posterior medians, else least squares; none before a fit."""
        from sysid.estimation.parameters.rockers import load_shares

        if self.fit is None:
            return ()
        sampled = None if self.posterior is None else {s.name: s for s in self.posterior.summaries}
        return load_shares(self.campaign.vehicle, self.fit.parameters, sampled)

    @property
    def input_sha256(self) -> Mapping[str, str]:
        """Hash of every input file: the one written down by the run, else the one taken when the campaign was read."""
        return self.provenance.get("input_sha256") or self.campaign.input_sha256
