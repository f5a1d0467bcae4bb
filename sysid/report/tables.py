"""Rows of the report's tables of results, ready to print: strings with their rounding done, no HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.balance.evidence import disagreement
from sysid.campaign.findings import ChannelFinding
from sysid.display import NOT_DETERMINED, Z90, channel_unit, shown_unit
from sysid.estimates.suspension_values import AxleEstimates, Quantity
from sysid.estimation.fit.thresholds import DECISIVE, SOLVERS_APART_SD, STEP_HALVING
from sysid.numbers import MISSING, decimals, fixed, interval, number, percent
from sysid.plot import SOURCE_LABELS, SOURCES, label
from sysid.report.cells import Cell, Table, axle_name, table
from sysid.results import Results

if TYPE_CHECKING:
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.parameters.estimate import ParameterEstimate
    from sysid.estimation.uncertainty.part_agreement import PartDifference
    from sysid.posterior.sampled_posterior import Posterior
    from sysid.vehicle_model.vibration_modes import NaturalModes


def masses_table(fit: FitResult) -> Table | None:
    """Declared mass properties with their tolerances and what the data make of them; None where all are exact."""
    if not fit.masses:
        return None
    rows = [
        [
            m.words,
            f"\N{PLUS-MINUS SIGN} {100.0 * m.tolerance:g} %",
            f"{100.0 * (m.estimate - 1.0):+.1f} \N{PLUS-MINUS SIGN} {100.0 * m.sd:.1f} %",
        ]
        for m in fit.masses
    ]
    return table("Declared masses", ["property", "tolerance", "change estimated"], rows)


def estimates_table(results: Results, quantity: Quantity) -> Table | None:
    """Stiffness or damping per axle: paper, corrected, fitted, posterior, each with its interval; None without any."""
    rows = results.suspension(quantity)
    if not rows:
        return None
    shown = ("paper", "corrected", "model", "fitted", "posterior")
    present = {s for row in rows for s in row.estimates}
    sources = [s for s in SOURCES if s in present and s in shown]
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


def parameters_table(results: Results, estimates: Iterable[ParameterEstimate], caption: str) -> Table:
    """Parameters with prior, least squares and posterior in units for people."""
    summaries = {} if results.posterior is None else {s.name: s for s in results.posterior.summaries}
    rows = []
    for p in estimates:
        factor, unit = shown_unit(p.unit)
        value, sd = p.value * factor, p.sd * factor
        places = decimals(value, Z90 * sd)
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
    halving, small = percent(fit.step_halving_error), f"below {percent(STEP_HALVING, 1)}"
    near = f"below {SOLVERS_APART_SD:g}"
    rows = [
        ("converged", "yes" if fit.converged else "no", "yes"),
        ("iterations", f"{fit.iterations:,}", ""),
        ("residuals", f"{fit.residuals:,}", ""),
        (
            "scaled condition number [-]",
            number(fit.condition_number),
            "tens; above 1,000 some are hard to separate",
        ),
        ("largest change when the integration step is halved", halving, small),
        (
            "largest difference from SciPy's optimum [sd]",
            number(fit.scipy_max_difference_sd, 2),
            near,
        ),
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
        factor, unit = channel_unit(f.si_unit)
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
    """What the campaign file declares about the axles: priors of masses and tires."""
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
    return table(f"Suspension laws tried; a gain of more than {DECISIVE:g} decides", head, rows, text_columns=1)


def parts_table(results: Results) -> Table | None:
    """Differences of k and c between parts of the data, one column per division of them; None without any."""
    differences = () if results.fit is None else results.fit.parts
    if not differences:
        return None
    divisions = list(dict.fromkeys((d.part, d.rest) for d in differences))
    cells = {(d.parameter, d.part): d for d in differences}
    rows = [
        [name, *(_difference_cell(cells[name, part]) for part, _ in divisions)]
        for name in dict.fromkeys(d.parameter for d in differences)
    ]
    head = ("parameter", *(f"{part} against {rest} [%]" for part, rest in divisions))
    return table(
        "k and c by parts of the data, with standard deviations; * more than chance", head, rows, text_columns=1
    )


def _difference_cell(d: PartDifference) -> str:
    return f"{100.0 * d.difference:+.1f} ± {100.0 * d.sd:.1f}" + (" *" if d.seen else "")


def balance_table(results: Results) -> Table | None:
    """k and c by the force balance with 90 % intervals, beside the fit where there is one; None without a balance."""
    balance = results.balance
    if balance is None or not balance.estimates:
        return None
    beside = {} if results.fit is None else {d.name: d for d in disagreement(balance, results.fit)}
    rows = []
    for e in balance.estimates:
        factor, unit = shown_unit(e.unit)
        shown = number(e.value * factor) if e.determined else NOT_DETERMINED
        row = [e.name, unit, shown, f"{number(e.low * factor)} to {number(e.high * factor)}"]
        if beside:
            d = beside.get(e.name)
            row += [MISSING, MISSING] if d is None else [number(d.fit * factor), f"{d.in_sd:+.1f}"]
        rows.append(row)
    head = ("parameter", "unit", "force balance", "90 % interval", *(("fit", "apart [sd]") if beside else ()))
    return table("k and c from the bodies alone, without road, bump or tire", head, rows, text_columns=2)


def driven_loads_table(results: Results) -> Table | None:
    """Load coefficients of road drives by the force balance; None without such drives."""
    if results.balance is None or not results.balance.loads:
        return None
    loads = results.balance.loads
    rows = [
        [
            d.file,
            d.load_case,
            *(f"{v:.3f} ({a:.3f} to {b:.3f})" for v, a, b in zip(d.coefficient, d.low, d.high, strict=True)),
        ]
        for d in loads
    ]
    axles = (f"axle {i + 1}" for i in range(len(loads[0].static_N)))
    title = "Load coefficients of road drives, to 25 Hz, with 90 % intervals"
    return table(title, ("log", "load case", *axles), rows, text_columns=2)


def driven_tires_table(results: Results) -> Table | None:
    """Tires by road drives, which share one road between their axles; None without such drives."""
    if results.balance is None or not results.balance.tires:
        return None
    rows = []
    for e in results.balance.tires:
        factor, unit = shown_unit(e.unit)
        shown = number(e.value * factor) if e.determined else NOT_DETERMINED
        rows.append([e.name, unit, shown, f"{number(e.low * factor)} to {number(e.high * factor)}"])
    return table("Tires by road drives", ("parameter", "unit", "value", "90 % interval"), rows, text_columns=2)


def driven_roads_table(results: Results) -> Table | None:
    """Speeds and roads of drives, as the axles tell them; None without such drives."""
    if results.balance is None or not results.balance.roads:
        return None
    rows = [
        [r.file, r.road_class, f"{3.6 * r.speed_m_s:.2f} ({3.6 * r.speed_low:.2f} to {3.6 * r.speed_high:.2f})",
         f"{1e6 * r.density_m3:.3g} ({1e6 * r.density_low:.3g} to {1e6 * r.density_high:.3g})", f"{r.waviness:.1f}"]
        for r in results.balance.roads
    ]  # fmt: skip
    head = ("log", "class", "speed [km/h]", "density at 0.1 cycles/m [cm³]", "waviness")
    return table("Roads of the drives, with 90 % intervals", head, rows, text_columns=2)


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


def _with_unit(value: float | None, factor: float, unit: str) -> str:
    return MISSING if value is None else f"{number(value * factor)}\u00a0{unit}"
