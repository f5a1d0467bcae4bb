"""Results of the plank-drop analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd

DropMethod = Literal["paper", "corrected", "free_decay", "model"]
DampingTerm = Literal["viscous", "friction", "quadratic"]

#: How the note of a single-axle estimate begins where the vehicle moves in more than the one mode that it assumes.
NOT_ALONE = "not usable alone"

_COLUMNS = (
    "axle",
    "load_case",
    "method",
    "stiffness",
    "stiffness_sd",
    "damping",
    "damping_sd",
    "damped_period",
    "log_decrement",
    "usable",
    "note",
    "damping_kind",
    "friction_force",
    "friction_force_sd",
    "quadratic_damping",
    "quadratic_damping_sd",
)


@dataclass(frozen=True)
class DampingLaw:
    """Viscous, dry and quadratic damping of one record, each apart, by a fit to its readings.

    x'' + 2 beta x' + q |x'| x' + f omega^2 sign(x') + omega^2 (x - x0) = 0.  `terms` are those the record shows;
    `runner_up` the next best mixture, `evidence` by how much its information criterion is worse.  `damped_period` [s]
    and `log_decrement` [-] are those of omega and beta alone, what the equations of a viscous axle take; `friction_m`
    is f = F/k [m], `quadratic_per_m` is q [1/m].  `covariance` (4, 4) is that of these four, zero where the term is
    absent (the decrement is fitted along in any case).  `shares` (3,) of viscous, dry and quadratic damping in the
    amplitude lost over `window_s` [s].  `stick_time_s` when the mass sticks, infinite where it does not; `level` x0
    [m]; `stiffening_per_m2` e of a spring force k y (1 + e y^2), 0 where the record shows none.  `time_s`,
    `model` (n,) the fitted motion; `noise_ratio` residual over the noise at rest.  `usable` False (NaN numbers, no
    terms) where `note` says why.
    """

    terms: tuple[DampingTerm, ...]
    runner_up: tuple[DampingTerm, ...]
    evidence: float
    damped_period: float
    log_decrement: float
    friction_m: float
    quadratic_per_m: float
    covariance: np.ndarray
    shares: np.ndarray
    level: float
    stiffening_per_m2: float
    stick_time_s: float
    window_s: tuple[float, float]
    time_s: np.ndarray
    model: np.ndarray
    residual_rms: float
    noise_ratio: float
    usable: bool
    note: str

    @property
    def kind(self) -> str:
        """The terms in words, ``unknown`` where there are none."""
        return " + ".join(self.terms) or "unknown"


@dataclass(frozen=True)
class DecayReading:
    """Result of peak-picking for one decay record (SI units, times from the start of the record).

    `settled_level` [m]; `extremum_time_s` and `extremum_value_m` (m,) alternating extrema refined below the sample
    step, relative to the record's own zero; `used` (m,) bool marks those that entered the averages. `damped_period` [s]
    and `log_decrement` [-] per full cycle, each with a standard error.

    - `damping_kind` tells how the decrement changes with amplitude: ``viscous`` (constant), ``friction`` (rises as the
      amplitude falls), ``quadratic`` (falls with the amplitude), ``unknown`` (too few peaks or too noisy to say);
    - `decrement_trend` is the slope of the decrement against relative amplitude, with its standard error.

    `usable` is False where there are not two usable peaks: then period, decrement and their errors are NaN and `note`
    says why.
    """

    settled_level: float
    settled_level_se: float
    extremum_time_s: np.ndarray
    extremum_value_m: np.ndarray
    used: np.ndarray
    damped_period: float
    damped_period_se: float
    log_decrement: float
    log_decrement_se: float
    damping_kind: Literal["viscous", "friction", "quadratic", "unknown"]
    decrement_trend: float
    decrement_trend_se: float
    usable: bool
    note: str


@dataclass(frozen=True)
class DropEstimate:
    """Stiffness [N/m] and damping [N s/m] of one axle by one method, from one file or pooled (`file` None).

    `stiffness_sd` and `damping_sd` are standard deviations (of the file's own estimate, or the scatter-based one of the
    pooled mean); NaN numbers with `usable` False mean that the record yields none, and `note` says why. `damping_kind`
    says which damping the record shows: ``viscous``, ``friction`` (dry), ``quadratic``, mixtures joined by " + ", or
    ``unknown``. If it shows more than viscous damping, `damping`, `damped_period` and `log_decrement` are those of the
    viscous part alone. Then `friction_force` [N] is the dry friction, and `quadratic_damping` [N s^2/m^2] the force
    over the squared velocity, each with its standard deviation. They are NaN if the record shows none.
    """

    axle: int
    load_case: str
    file: str | None
    method: DropMethod
    stiffness: float
    stiffness_sd: float
    damping: float
    damping_sd: float
    damped_period: float
    log_decrement: float
    usable: bool
    note: str = ""
    damping_kind: str = "unknown"
    friction_force: float = float("nan")
    friction_force_sd: float = float("nan")
    quadratic_damping: float = float("nan")
    quadratic_damping_sd: float = float("nan")

    @property
    def caution(self) -> str:
        """Why the numbers must not be used as they are: the note of an unusable one, or why it is not usable alone."""
        if not self.usable:
            return self.note
        return next((part for part in self.note.split("; ") if part.startswith(NOT_ALONE)), "")


@dataclass(frozen=True)
class DropAnalysis(Tabular):
    """Everything about one plank-drop file: the trace, the picked peaks, the free-decay model and the estimates.

    - `time_s`, `deflection_m` (n,) as measured;
    - `filtered_m` (n,) with wheel hop kept out, as used for picking;
    - `release_time_s` is when the axle leaves the plank;
    - `free_decay_m` (n,): the fitted decay model, NaN outside its window;
    - `second_drop_s` is when a second drop begins in the same file, up to which it is read, NaN where there is none.

    `frequency_hz` and `damping_ratio_directive` (D = ln(A1/A2)/2pi) are the EU 96/53/EC Annex II / VSB 11 indicator.

    - `law` is the mixture of viscous, dry and quadratic damping that explains the record better than viscous damping of
      body and wheel hop does, None where none does;
    - `damping_kind` what the record shows, as in `DropEstimate`.
    """

    axle: int
    load_case: str
    file: str
    tributary_mass_kg: float
    time_s: np.ndarray
    deflection_m: np.ndarray
    filtered_m: np.ndarray
    release_time_s: float
    reading: DecayReading
    free_decay_m: np.ndarray
    free_decay_note: str
    estimates: tuple[DropEstimate, ...]
    frequency_hz: float
    damping_ratio_directive: float
    damping_kind: str = "unknown"
    law: DampingLaw | None = None
    second_drop_s: float = float("nan")

    def summary(self) -> pd.DataFrame:
        """One row per method, in SI units."""
        return records_table(self.estimates, ("file", *_COLUMNS))

    def to_pandas(self) -> pd.DataFrame:
        """Time [s], and deflection as measured, filtered and by the free-decay model [m], one row per sample."""
        import pandas as pd

        names = ("time_s", "deflection_m", "filtered_m", "free_decay_m")
        return pd.DataFrame({name: getattr(self, name) for name in names})


@dataclass(frozen=True)
class DropSummary(Tabular):
    """All plank drops of a campaign: one analysis per file and pooled estimates per axle, load case and method."""

    files: tuple[DropAnalysis, ...]
    pooled: tuple[DropEstimate, ...]
    messages: tuple[str, ...] = ()

    def summary(self) -> pd.DataFrame:
        """One row per entry, in SI units."""
        return records_table(self.pooled, _COLUMNS)

    def to_pandas(self) -> pd.DataFrame:
        """Estimates of every file and pooled ones, where `file` is empty."""
        estimates = [e for analysis in self.files for e in analysis.estimates]
        return records_table([*estimates, *self.pooled], ("file", *_COLUMNS))
