"""What a comparison of two campaigns says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sysid.display import Z90
from sysid.export.identity import Identity
from sysid.results.contents import Status, Trust
from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd

#: Suspensions, tires and static axle loads are three families of quantities; peak axle loads follow from all of them.
Family = Literal["suspension", "tires", "static loads", "peak loads"]
FAMILIES: tuple[Family, ...] = ("suspension", "static loads", "peak loads", "tires")


@dataclass(frozen=True)
class Difference:
    """How one quantity differs between two campaigns.

    - `name`, `quantity`, `axle` (from 1), `load_cases` of the first and the second;
    - `unit` (SI), `first`, `second`: medians and ends of 90 % intervals (median, 5 %, 95 %);
    - `log_ratio` of second over first and its standard deviation `log_sd`, shared errors cancelled;
    - `p_adjusted`: probability that, of all quantities of the family, one would seem to differ as clearly though none
      does, None where none is tested;
    - `changed`: whether this is below :data:`sysid.comparison.differences.ERROR_RATE`.
    - `least_seen`: smallest relative change that would be called one here.
    """

    family: Family
    name: str
    quantity: str
    axle: int | None
    load_cases: tuple[str | None, str | None]
    unit: str
    first: tuple[float, float, float]
    second: tuple[float, float, float]
    log_ratio: float
    log_sd: float
    note: str = ""
    p_adjusted: float | None = None
    changed: bool = False
    least_seen: float | None = None

    @property
    def change(self) -> tuple[float, float, float]:
        """Relative change from the first to the second: median, 5 % and 95 %."""
        half = Z90 * self.log_sd
        middle, low, high = (math.expm1(self.log_ratio + d) for d in (0.0, -half, half))
        return middle, low, high

    @property
    def probability_larger(self) -> float:
        """Probability that the second is larger than the first."""
        if self.log_sd == 0.0:
            return 0.5 + 0.5 * math.copysign(1.0, self.log_ratio) if self.log_ratio else 0.5
        return 0.5 * math.erfc(-self.log_ratio / (self.log_sd * math.sqrt(2.0)))


@dataclass(frozen=True)
class Campaign:
    """One campaign of a comparison: `label` in tables, what it is, and whether its numbers may be used."""

    label: str
    title: str
    vehicle: str
    test: Mapping[str, str | None]
    identity: Identity
    status: Status
    trust: Trust | None
    reasons: tuple[str, ...]

    @property
    def doubtful(self) -> bool:
        """Whether its own verdict forbids to rely on its numbers."""
        return self.trust in ("do_not_bet", "not_yet", None)


@dataclass(frozen=True)
class Agreement:
    """How well one campaign's truck explains a run of the other: medians over its channels.

    `own` residual over noise before the bump in the fit of the campaign that recorded the run, `other` by the truck of
    the other campaign, which has not seen the run; None where no channel shows its noise.
    """

    run: str
    recorded_by: str
    own: float | None
    other: float | None


@dataclass(frozen=True)
class Comparison(Tabular):
    """The second of two campaigns against the first.

    - `one_truck`: whether both are of one truck;
    - `differences` by family, the order of the parameters kept;
    - `shared`: errors that both have in common, in words; `remarks`: sentences to read with the table;
    - `undecided`: why nothing of the suspensions is called changed, empty where that can be said;
    - `agreement` on each other's runs, empty where no campaign files were given.
    """

    first: Campaign
    second: Campaign
    one_truck: bool
    differences: tuple[Difference, ...]
    shared: tuple[str, ...]
    remarks: tuple[str, ...]
    undecided: str = ""
    agreement: tuple[Agreement, ...] = ()

    @property
    def changed(self) -> tuple[Difference, ...]:
        """What has changed."""
        return tuple(d for d in self.differences if d.changed)

    def of(self, family: Family) -> tuple[Difference, ...]:
        """Differences of one family."""
        return tuple(d for d in self.differences if d.family == family)

    def __getitem__(self, name: str) -> Difference:
        """The difference of a quantity by its name, as in the first campaign: ``comparison["c_2"].change``.

        Raises
        ------
        KeyError
            If there is none.
        """
        for d in self.differences:
            if d.name == name:
                return d
        raise KeyError(f"the comparison has no '{name}'; use one of {', '.join(d.name for d in self.differences)}")

    _in_row_unit = tuple(f"{side}_{q}" for side in ("first", "second") for q in ("q50", "q05", "q95"))

    def summary(self) -> pd.DataFrame:
        """One row per quantity, SI."""
        import pandas as pd

        return pd.DataFrame([row(self, d) for d in self.differences])


def row(comparison: Comparison, d: Difference) -> dict[str, object]:
    """What tables and files hold of a difference, in their order."""
    change, low, high = d.change
    return {
        "first": comparison.first.label,
        "second": comparison.second.label,
        "family": d.family,
        "name": d.name,
        "quantity": d.quantity,
        "axle": d.axle,
        "load_case_first": d.load_cases[0],
        "load_case_second": d.load_cases[1],
        "unit": d.unit,
        **{f"first_{q}": v for q, v in zip(("q50", "q05", "q95"), d.first, strict=True)},
        **{f"second_{q}": v for q, v in zip(("q50", "q05", "q95"), d.second, strict=True)},
        "change": change,
        "change_q05": low,
        "change_q95": high,
        "probability_larger": d.probability_larger,
        "p_adjusted": d.p_adjusted,
        "changed": d.changed,
        "least_seen": d.least_seen,
        "note": d.note,
    }
