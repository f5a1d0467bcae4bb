"""Rows of the tables of the report, ready to print: strings with their rounding done, no HTML."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.campaign.findings import ChannelFinding
from sysid.export import Results, prediction_files
from sysid.plot import SOURCE_LABELS, SOURCES, AxleEstimates, label, suspension_estimates
from sysid.plot.comparison import Quantity
from sysid.report.numbers import MISSING, decimals, fixed, interval, number, percent, speed
from sysid.sdof.results import DropAnalysis, DropEstimate, DropSummary

if TYPE_CHECKING:
    from sysid.estimation.results import FitResult, ParameterEstimate
    from sysid.posterior.results import Posterior
    from sysid.prediction.results import Quantiles
    from sysid.vehicle_model.modes import NaturalModes

#: What stands in place of a number that only repeats its prior.
NOT_DETERMINED = "not determined"

_DISPLAY_UNITS = {"N/m": (1e-3, "kN/m"), "N s/m": (1e-3, "kN s/m"), "N*s/m": (1e-3, "kN s/m"), "N": (1e-3, "kN")}


@dataclass(frozen=True)
class Cell:
    """One table cell: the value, its 90 % interval in brackets, and a word of caution."""

    text: str
    interval: str = ""
    note: str = ""


@dataclass(frozen=True)
class Table:
    """A table: `head` per column, `rows` of a row heading followed by cells; `numeric` marks right-aligned columns."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numeric: tuple[bool, ...]
    classes: str = ""


def table(
    caption: str, head: Iterable[str], rows: Iterable[Iterable[Any]], text_columns: int = 1, classes: str = ""
) -> Table:
    """A `Table` from plain values; the first `text_columns` columns are left-aligned."""
    columns = tuple(re.sub(r"\[[^]]*\]", lambda unit: unit[0].replace(" ", "\u00a0"), text) for text in head)
    cells = tuple(tuple(c if isinstance(c, Cell) else Cell(str(c)) for c in row) for row in rows)
    return Table(caption, columns, cells, tuple(i >= text_columns for i in range(len(columns))), classes)


def masses_table(fit: FitResult) -> Table | None:
    """Declared mass properties with their tolerances and what the data would ask for; None where all are exact."""
    if not fit.masses:
        return None
    rows = [
        [m.words, f"\N{PLUS-MINUS SIGN} {100.0 * m.tolerance:g} %", f"{100.0 * (m.asked - 1.0):+.1f} %"]
        for m in fit.masses
    ]
    return table("Declared masses", ["property", "tolerance", "the data ask for"], rows)


def axle_name(results: Results, axle: int, load_case: str | None = None) -> Cell:
    """Heading of a row: the axle's number, and below it its name and load case."""
    name = results.campaign.vehicle.axles[axle].name
    return Cell(f"axle {axle + 1}", note=name + (f", {load_case}" if load_case else ""))


def estimates_table(results: Results, quantity: Quantity) -> Table | None:
    """Stiffness or damping per axle: paper, corrected, fitted, posterior, each with its interval; None without any."""
    rows = suspension_estimates(quantity, results.drops, results.fit, results.posterior)
    if not rows:
        return None
    sources = [
        s for s in SOURCES if s in ("paper", "corrected", "fitted", "posterior") or any(s in r.estimates for r in rows)
    ]
    always = ("paper", "corrected", "model", "fitted", "posterior")
    present = {s for row in rows for s in row.estimates}
    sources = [s for s in SOURCES if s in present and s in always]
    unit, name = ("kN/m", "Stiffness k") if quantity == "stiffness" else ("kN s/m", "Damping c")
    head = ["axle", *(f"{SOURCE_LABELS[s]} [{unit}]" for s in sources)]
    body = [[axle_name(results, row.axle, row.load_case), *(_estimate_cell(row, s) for s in sources)] for row in rows]
    return table(f"{name} per axle, both sides together, with 90 % intervals", head, body, classes="estimates")


def _estimate_cell(row: AxleEstimates, source: Any) -> Cell:
    e = row.estimates.get(source)
    if e is None:
        dropless = source in ("paper", "corrected", "model") and row.drop_load_case is None
        return Cell(MISSING, note="no drop in this load case" if dropless and "fitted" in row.estimates else "")
    if not (e.usable and math.isfinite(e.value)):
        return Cell(MISSING, note="not readable")
    value, low, high = e.value / 1e3, e.low / 1e3, e.high / 1e3
    places = decimals(value, (high - low) / 2.0)
    if not e.identified:
        return Cell(NOT_DETERMINED, interval(low, high, places), "prior only")
    return Cell(fixed(value, places), interval(low, high, places), "caution, see plank drops" if e.note else "")


def pooled_drops_table(results: Results, drops: DropSummary) -> Table:
    """Pooled drop estimates, one row per axle and load case, one column per quantity and method."""
    groups: dict[tuple[int, str], dict[str, DropEstimate]] = {}
    for e in drops.pooled:
        groups.setdefault((e.axle, e.load_case), {})[e.method] = e
    methods = [s for s in SOURCES if any(s in found for found in groups.values())]
    rows = []
    for (axle, load_case), found in sorted(groups.items()):
        cells: list[Any] = [axle_name(results, axle, load_case)]
        reading = found.get("paper") or next(iter(found.values()))
        cells += [number(reading.damped_period), number(reading.log_decrement)] if reading.usable else [MISSING] * 2
        cells += [_pooled_cell(found.get(m), "stiffness") for m in methods]
        cells += [_pooled_cell(found.get(m), "damping") for m in methods]
        rows.append(cells)
    head = ["axle", "period τ_d [s]", "decrement δ [-]"]
    head += [f"k {SOURCE_LABELS[m]} [kN/m]" for m in methods] + [f"c {SOURCE_LABELS[m]} [kN s/m]" for m in methods]
    return table("Plank drops, mean ± standard deviation pooled over the repeats", head, rows)


def pooled_notes(drops: DropSummary) -> list[str]:
    """Notes on the pooled estimates, each once, with the axle it belongs to."""
    notes: dict[tuple[int, str], dict[str, None]] = {}
    for e in drops.pooled:
        for part in filter(None, e.note.split("; ")):
            notes.setdefault((e.axle, e.load_case), {})[part] = None
    return [f"axle {axle + 1}, {case}: {'; '.join(parts)}" for (axle, case), parts in sorted(notes.items())]


def _pooled_cell(e: DropEstimate | None, quantity: Quantity) -> str:
    if e is None or not e.usable:
        return MISSING
    value, sd = (e.stiffness, e.stiffness_sd) if quantity == "stiffness" else (e.damping, e.damping_sd)
    return _plus_minus(value / 1e3, sd / 1e3)


def files_table(results: Results, drops: DropSummary) -> Table:
    """What peak-picking read off every single drop."""
    rows = []
    for a in drops.files:
        r = a.reading
        rows.append(
            [
                Cell(a.file, note=f"axle {a.axle + 1}, {a.load_case}"),
                f"{int(np.sum(r.used))} of {len(r.used)}",
                _plus_minus(r.damped_period, r.damped_period_se),
                _plus_minus(r.log_decrement, r.log_decrement_se),
                r.damping_kind,
                Cell("yes" if r.usable else "no", note=r.note),
            ]
        )
    head = ("file", "peaks used", "period ± se [s]", "decrement ± se [-]", "damping looks", "usable")
    return table("Readings of every drop", head, rows)


def without_dampers(results: Results) -> frozenset[str]:
    """Files of the drops that were made with the dampers removed."""
    return frozenset(d.log.file for d in results.campaign.plank_drops if not d.dampers)


def indicator_table(results: Results, drops: DropSummary) -> Table:
    """Frequency and damping of the EU 96/53/EC Annex II / VSB 11 test, mean over the usable drops of an axle."""
    rows = []
    groups: dict[tuple[int, str, bool], list[DropAnalysis]] = {}
    bare = without_dampers(results)
    for a in drops.files:
        groups.setdefault((a.axle, a.load_case, a.file in bare), []).append(a)
    for (axle, load_case, removed), files in sorted(groups.items()):
        usable = [a for a in files if a.reading.usable]
        frequency = _mean([a.frequency_hz for a in usable])
        damping = _mean([a.damping_ratio_directive for a in usable])
        rows.append(
            [
                axle_name(results, axle, load_case + (", dampers removed" if removed else "")),
                number(frequency),
                _against(frequency, frequency <= 2.0),
                percent(damping, 3),
                _against(damping, damping > 0.2),
            ]
        )
    head = ("axle", "frequency f [Hz]", "f ≤ 2.0 Hz", "damping D [%]", "D > 20 %")
    return table("Indicator only, not compliance: EU 96/53/EC Annex II and VSB 11", head, rows)


def parameters_table(results: Results, estimates: Iterable[ParameterEstimate], caption: str) -> Table:
    """Parameters with prior, least squares and posterior in units for people."""
    summaries = {} if results.posterior is None else {s.name: s for s in results.posterior.summaries}
    rows = []
    for p in estimates:
        factor, unit = _DISPLAY_UNITS.get(p.unit, (1.0, p.unit))
        value, sd = p.value * factor, p.sd * factor
        places = decimals(value, 1.645 * sd)
        s = summaries.get(p.name)
        rows.append(
            [
                Cell(p.name, note="" if p.identified else "prior only"),
                p.quantity.replace("_", " "),
                p.law,
                unit,
                number(p.prior_median * factor),
                f"{fixed(value, places)} ± {number(sd, 2)}" if p.identified else NOT_DETERMINED,
                MISSING
                if s is None
                else Cell(
                    fixed(s.q50 * factor, places) if p.identified else NOT_DETERMINED,
                    interval(s.q05 * factor, s.q95 * factor, places),
                ),
                MISSING if s is None else number(s.ess),
                MISSING if s is None else fixed(s.rhat, 3),
            ]
        )
    head = (
        "parameter",
        "quantity",
        "law",
        "unit",
        "prior median",
        "least squares ± sd",
        "posterior median [90 % credible]",
        "effective draws",
        "R-hat",
    )
    return table(caption, head, rows, text_columns=4)


def fit_table(fit: FitResult) -> Table:
    """Diagnostics of the least-squares fit next to what a good fit shows."""
    rows = [
        ("converged", "yes" if fit.converged else "no", "yes"),
        ("iterations", f"{fit.iterations:,}", ""),
        ("residuals", f"{fit.residuals:,}", ""),
        ("rounds of re-estimated channel weights", str(fit.weight_rounds), ""),
        ("scaled condition number [-]", number(fit.condition_number), "tens; above 1,000 parameters trade off"),
        ("largest change when the integration step is halved", percent(fit.step_halving_error), "below 0.01 %"),
        ("largest difference from SciPy's optimum [sd]", number(fit.scipy_max_difference_sd, 2), "below 0.1"),
        ("inflation of variances for correlated residuals [-]", number(fit.variance_inflation), "1 = white residuals"),
        ("inflation of standard deviations for model error [-]", number(fit.model_error_inflation), "1 = no misfit"),
        ("tire contact", fit.contact, ""),
    ]
    return table("Diagnostics of the least-squares fit", ("quantity", "value", "what a good fit shows"), rows, 3)


def posterior_table(p: Posterior) -> Table:
    """Diagnostics of the sampling next to what a converged run shows."""
    ensembles, steps, walkers, count = p.draws.shape
    rhat = max((s.rhat for s in p.summaries), default=math.nan)
    ess = min((s.ess for s in p.summaries), default=math.nan)
    acceptance = [float(a) for a in np.atleast_1d(p.acceptance)]
    tau = float(np.max(p.autocorrelation_time)) if np.size(p.autocorrelation_time) else math.nan
    rows = [
        ("independent ensembles", str(ensembles), "at least 2"),
        ("kept draws", f"{ensembles * steps * walkers:,}", f"{steps:,} steps of {walkers} walkers per ensemble"),
        ("parameters", str(count), ""),
        ("burn-in, thinning [steps]", f"{p.burn_in:,}, {p.thin:,}", "several autocorrelation times"),
        ("longest autocorrelation time [steps]", number(tau), ""),
        ("acceptance [-]", f"{number(min(acceptance), 2)} to {number(max(acceptance), 2)}", "0.2 to 0.5"),
        ("worst R-hat [-]", fixed(rhat, 3), "below 1.01"),
        ("fewest effective draws", number(ess), "above 400"),
        ("seed", str(p.seed), ""),
    ]
    return table("Diagnostics of the sampling", ("quantity", "value", "what a converged run shows"), rows, 3)


def quality_table(findings: Iterable[ChannelFinding], caption: str) -> Table:
    """Findings of the quality check, one channel of one log per row."""
    rows = []
    for f in findings:
        unit = "mm" if f.si_unit == "m" else "m/s²"
        factor = 1e3 if f.si_unit == "m" else 1.0
        rows.append(
            [
                Cell(f.column, note=f.file),
                f.verdict,
                f"{f.samples:,}",
                number(f.rate_hz),
                f"{f.missing:,}",
                f"{f.clipped:,}",
                _with_unit(f.noise_rms, factor, unit),
                _with_unit(f.peak, factor, unit),
                Cell(" ".join(f.messages)),
            ]
        )
    head = ("channel", "verdict", "samples", "rate [Hz]", "missing", "clipped", "noise rms", "peak", "finding")
    made = table(caption, head, rows, text_columns=2)
    return Table(made.caption, made.head, made.rows, (*made.numeric[:-1], False), "findings")


def prediction_tables(results: Results) -> list[Table]:
    """Peak wheel loads of every predicted pass."""
    if results.predictions is None:
        return []
    tables = []
    passes = results.predictions.passes
    kind = "90 % credible interval" if results.predictions.source == "posterior" else "least squares, no interval yet"
    for p, file in zip(passes, prediction_files(passes), strict=True):
        rows = []
        for i, static in enumerate(p.static_load_N):
            ratio = float(p.peak_ratio_q50[i])
            low, high = (None if q is None else float(q[i]) for q in (p.peak_ratio_q05, p.peak_ratio_q95))
            load = float(static) / 1e3
            places = decimals(ratio * load)
            force = interval(None if low is None else low * load, None if high is None else high * load, places)
            rows.append(
                [
                    axle_name(results, i),
                    number(load),
                    Cell(fixed(ratio, 2), interval(low, high, 2)),
                    Cell(fixed(ratio * load, places), force),
                    _band(p.load_coefficient, i, 2),
                    "yes" if p.lift_off[i] else "no",
                    _band(p.lift_off_s, i, 0, 1e3),
                    _travel(p.jounce_m, i, results.campaign.vehicle.axles[i].jounce_travel_m),
                    _travel(p.rebound_m, i, results.campaign.vehicle.axles[i].rebound_travel_m),
                    _band(p.impulse_ratio, i, 3),
                ]
            )
        head = (
            "axle",
            "static load [kN]",
            "peak / static load [-]",
            "peak wheel load [kN]",
            "dynamic load coefficient [-]",
            "leaves the ground",
            "off the ground [ms]",
            "compression [mm]",
            "extension [mm]",
            "mean / static load [-]",
        )
        over = f" over {p.shape}" if p.shape else ""
        caption = (
            f"{p.load_case}, {speed(p.speed_m_s)} km/h{over}: peak wheel loads, both sides together ({kind}); "
            f"histories in {file}"
        )
        tables.append(table(caption, head, rows))
    return tables


def _band(values: Quantiles | None, axle: int | tuple[int, int], places: int, factor: float = 1.0) -> Cell:
    if values is None:
        return Cell(MISSING)
    low, high = (None if q is None else factor * float(q[axle]) for q in (values.q05, values.q95))
    return Cell(fixed(factor * float(values.q50[axle]), places), interval(low, high, places))


def _travel(values: Quantiles | None, axle: int, declared_m: float | None) -> Cell:
    found = _band(values, axle, 0, 1e3)
    return Cell(found.text, found.interval, "none declared" if declared_m is None else f"of {1e3 * declared_m:.0f}")


def sweep_tables(results: Results) -> list[Table]:
    """Peak load ratio against speed, a table per load case."""
    sweeps = () if results.predictions is None else results.predictions.sweeps
    tables = []
    for s in sweeps:
        axles = range(s.peak_ratio.q50.shape[1])
        rows = [
            [f"{speed(float(v))}", *(_band(s.peak_ratio, (i, axle), 2) for axle in axles)]
            for i, v in enumerate(s.speed_m_s)
        ]
        head = ("speed [km/h]", *(f"axle {axle + 1} [-]" for axle in axles))
        tables.append(table(f"{s.load_case}: peak dynamic load ratio against speed", head, rows))
    return tables


def flat_settings(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows of (dotted name, value)."""
    rows: list[tuple[str, str]] = []
    for key, value in settings.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            rows += flat_settings(value, f"{name}.")
        else:
            rows.append((name, str(value)))
    return rows


def vehicle_table(results: Results) -> Table:
    """What the campaign file declares about the axles: taken as given, not estimated (tire values are priors)."""
    cases = results.campaign.load_cases
    head = (
        "axle",
        "suspension",
        "x [m]",
        *(f"axle load {name} [kg]" for name in cases),
        "unsprung mass [kg]",
        "tire k [kN/m]",
    )
    rows = [
        [
            axle_name(results, i),
            a.suspension,
            number(a.x_m),
            *(number(case.axle_loads_kg[i], 4) for case in cases.values()),
            number(a.unsprung_mass_kg, 4),
            number(a.tire_stiffness_N_per_m / 1e3, 4),
        ]
        for i, a in enumerate(results.campaign.vehicle.axles)
    ]
    return table("Vehicle as declared in the campaign file", head, rows, text_columns=2)


def law_table(results: Results) -> Table | None:
    """Suspension laws that were tried, with what each gained; None where none was."""
    comparison = None if results.fit is None else results.fit.law_comparison
    if comparison is None:
        return None
    rows = []
    for t in comparison.trials:
        names = [f"axle {i + 1}: {law}" for i, law in enumerate(t.laws)]
        laws = t.laws[0] if len(set(t.laws)) == 1 else "; ".join(names)
        chosen = "yes" if t.laws == comparison.chosen else ""
        rows.append([laws, str(t.parameters), number(t.misfit, 2), number(t.gain), chosen])
    head = ("suspension laws", "parameters", "residual / noise", "gain in the criterion", "chosen")
    return table("Suspension laws tried; a gain of more than 10 decides", head, rows, text_columns=1)


def contact_table(results: Results) -> Table | None:
    """Stiffness and damping by contact law of the tires; None where the fit was not repeated with others."""
    fit = results.fit
    if fit is None or not fit.contact_trials:
        return None
    shown = [(i, p) for i, p in enumerate(fit.parameters) if p.quantity in ("stiffness", "damping")]
    rows: list[list[str]] = [["residual / noise", "", *(number(t.misfit, 2) for t in fit.contact_trials)]]
    for i, p in shown:
        unit = "kN/m" if p.quantity == "stiffness" else "kN s/m"
        rows.append([p.name, unit, *(number(t.values[i] / 1e3, 4) for t in fit.contact_trials)])
    head = ("parameter", "unit", *(t.contact for t in fit.contact_trials))
    return table("The same fit with other contact laws of the tires", head, rows, text_columns=2)


def modes_table(modes: Sequence[NaturalModes]) -> Table | None:
    """Natural frequencies and damping ratios, one row per load case and mode; None without any."""
    rows = [
        [
            m.load_case.name,
            str(k + 1),
            label(m.dominant[k]),
            number(float(m.frequency_hz[k])),
            percent(float(m.damping_ratio[k]), 3),
            number(float(m.damped_frequency_hz[k])),
        ]
        for m in modes
        for k in range(m.frequency_hz.size)
    ]
    head = ("load case", "mode", "moves most", "natural frequency [Hz]", "damping ratio ζ [%]", "damped frequency [Hz]")
    return table("Natural modes of the calibrated truck", head, rows, text_columns=3) if rows else None


def _plus_minus(value: float, sd: float) -> str:
    if not math.isfinite(value):
        return MISSING
    places = decimals(value, 1.645 * sd)
    return fixed(value, places) + (f" ± {number(sd, 2)}" if math.isfinite(sd) else "")


def _with_unit(value: float | None, factor: float, unit: str) -> str:
    return MISSING if value is None else f"{number(value * factor)}\u00a0{unit}"


def _mean(values: list[float]) -> float:
    finite = [v for v in values if math.isfinite(v)]
    return sum(finite) / len(finite) if finite else math.nan


def _against(value: float, holds: bool) -> str:
    return MISSING if not math.isfinite(value) else ("yes" if holds else "no")
