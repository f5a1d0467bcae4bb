"""Results of the plank-drop analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sysid.tabular import Tabular, records_table

if TYPE_CHECKING:
    import pandas as pd

DropMethod = Literal["paper", "corrected", "free_decay", "model"]

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
class DecayFit:
    """The motion after one drop as that of a quarter car, averaged over models of it (`sysid.sdof.decay_fit`).

    - `stiffness` [N/m] and `damping` [N s/m] with their `covariance` (2, 2), of which repeats do not average out
      `common_variance` (2,): declared quantities, the choice of the model, and what no model explains;
    - `damped_period` [s], `log_decrement` [-] of the body mode of this quarter car;
    - `models`: names and probabilities of the models that count; `probability` of each element: ``friction``,
      ``progressive``, ``asymmetric``, ``quadratic``, ``mode``;
    - `friction_force` [N], `slip_m` [m], `quadratic_damping` [N s^2/m^2], `asymmetry` [-] (rebound less compression
      over their sum), `bend_per_m` [1/m] and `cubic_per_m2` [1/m^2] of a spring force k y (1 + b y + e y^2): (value,
      standard deviation) over the models that have it, NaN where none has;
    - `mode_hz`, `mode_strength`: frequency of the further mode [Hz] and its strength over that of the quarter car
      (square root of the integral of the squared motion);
    - `linear_bias` (2,): error of k and c of the best model with linear laws alone, relative to its own values;
    - `window_s` [s], `time_s`, `model` (n,): the part that was fitted and the most probable motion [m];
    - `noise_ratio`: residual over the noise; `unexplained`: residual over the motion, both without the noise.
    """

    stiffness: float
    damping: float
    covariance: np.ndarray
    common_variance: np.ndarray
    damped_period: float
    log_decrement: float
    models: tuple[tuple[str, float], ...]
    probability: dict[str, float]
    friction_force: tuple[float, float]
    slip_m: tuple[float, float]
    quadratic_damping: tuple[float, float]
    asymmetry: tuple[float, float]
    bend_per_m: tuple[float, float]
    cubic_per_m2: tuple[float, float]
    mode_hz: float
    mode_strength: float
    linear_bias: np.ndarray
    window_s: tuple[float, float]
    time_s: np.ndarray
    model: np.ndarray
    noise_ratio: float
    unexplained: float


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
    ``unknown``. `damping` of method ``free_decay`` is the viscous part alone, the mean of both ways of a damper. If the
    record shows them, `friction_force` [N] is the dry friction, and `quadratic_damping` [N s^2/m^2] the force over the
    squared velocity, each with its standard deviation. They are NaN if it shows none.
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

    - `fit` is the quarter car fitted to the readings, None where there were too few;
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
    fit: DecayFit | None = None
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
