"""Figures of the report: inline SVG with a caption and a description for those who cannot see it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from sysid import plot
from sysid.estimates.suspension_values import Quantity
from sysid.helper_process import shared_with_helper
from sysid.numbers import count, number, percent, speed
from sysid.report.drawing import Drawing, Draws, drawn
from sysid.report.drop_tables import without_dampers
from sysid.report.load_tables import sweep_name
from sysid.results import Results
from sysid.results.pass_limits import pass_name
from sysid.sdof.drop_results import DropAnalysis

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sysid.campaign.vehicle_records import LoadCase
    from sysid.estimation.fit.fit_result import FitResult
    from sysid.estimation.residuals.run_history import RunHistory
    from sysid.vehicle_model.vibration_modes import NaturalModes

_MOST_CORNER = 14
_MOST_MARGINALS = 48
#: Passes of which the paper's Figure 9 is shown.
_MOST_PASSES = 2


@dataclass
class Picture:
    """One figure of the page: its caption, its width class, and the `<svg>` element once the gallery is drawn."""

    caption: str
    width: str = "wide"
    svg: Markup = field(default_factory=Markup)


class Gallery:
    """Numbers the identifiers of pictures, so that no two clash on the page, and draws all together."""

    def __init__(self) -> None:
        self._pictures: list[Picture] = []
        self._drawings: list[Drawing] = []

    def picture(self, draws: Draws, caption: str, description: str = "", width: str = "wide") -> Picture:
        """A picture that is still to be drawn; `description`, if any, replaces the caption for screen readers."""
        self._pictures.append(Picture(caption, width))
        self._drawings.append(Drawing(draws, f"f{len(self._pictures)}", description or caption))
        return self._pictures[-1]

    def draw(self, done: Callable[[float], None] = lambda share: None) -> None:
        """Draw all pictures; `done` is told the share that is drawn."""
        for picture, svg in zip(self._pictures, shared_with_helper(drawn, self._drawings, done), strict=True):
            # It was written and escaped by an XML serialiser; only this element may pass unescaped into the page.
            picture.svg = Markup(svg)


def comparison_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Estimates of k and of c per axle side by side."""
    pictures = []
    quantities: tuple[tuple[Quantity, str], ...] = (("stiffness", "Stiffness"), ("damping", "Damping"))
    for quantity, name in quantities:
        rows = results.suspension(quantity)
        if any(row.best is not None for row in rows):
            caption = f"{name} per axle: marker = method, colour = axle, bar = 90 % interval."
            pictures.append(gallery.picture(partial(plot.comparison, rows, quantity), caption, width="half"))
    return pictures


def _drop_groups(results: Results) -> dict[tuple[int, str], list[DropAnalysis]]:
    groups: dict[tuple[int, str], list[DropAnalysis]] = {}
    for analysis in () if results.drops is None else results.drops.files:
        groups.setdefault((analysis.axle, analysis.load_case), []).append(analysis)
    return groups


def representative_drops(results: Results) -> list[DropAnalysis]:
    """One drop per axle and load case, front to rear: the first usable one that was made with dampers."""
    bare, groups = without_dampers(results), _drop_groups(results)
    return [min(files, key=lambda a: (a.file in bare, not a.reading.usable)) for _, files in sorted(groups.items())]


def drop_pictures(results: Results, gallery: Gallery) -> tuple[list[Picture], list[Picture]]:
    """One drop per axle and load case for the page, and all drops, a figure per axle, for the fold."""
    if results.drops is None or not results.drops.files:
        return [], []
    groups = _drop_groups(results)
    several = len({load_case for _, load_case in groups}) > 1
    first = representative_drops(results)
    titles = [f"axle {a.axle + 1}" + (f", {plot.label(a.load_case, 20)}" if several else "") for a in first]
    overview = partial(plot.drops, first, titles)
    caption = (
        "One drop per axle. Filled circles are the peaks that entered period and decrement, open ones did not; the "
        "grey lines are the envelope of the decrement, the vertical line is the moment the axle leaves the plank."
    )
    shown = [gallery.picture(overview, caption, f"{caption} {' '.join(_drop_words(a) for a in first)}")]
    of_all = [
        gallery.picture(
            partial(plot.drops, files),
            f"Axle {axle + 1} ({results.campaign.vehicle.axles[axle].name}), {load_case}: "
            f"{count(len(files), 'drop')}. {' '.join(_drop_words(a) for a in files)}",
        )
        for (axle, load_case), files in sorted(groups.items())
    ]
    return shown, of_all


def _drop_words(analysis: DropAnalysis) -> str:
    r = analysis.reading
    name = f"{analysis.file.rsplit('/', 1)[-1]}:"
    if not r.usable:
        return f"{name} not usable, {r.note or 'no two usable peaks'}."
    return (
        f"{name} period {number(r.damped_period)} s, decrement {number(r.log_decrement)}, "
        f"{int(np.sum(r.used))} of {count(len(r.used), 'peak')} used."
    )


def first_load_case(results: Results) -> LoadCase:
    """The load case at which the tires are declared."""
    return next(iter(results.campaign.load_cases.values()))


def scan_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Profile and cloud of every scan."""
    pictures = []
    for name, analysis in results.scans.items():
        p = analysis.profile
        peak = float(np.max(p.height_m)) * 1e3 if len(p.height_m) else float("nan")
        caption = f"Profile of {name}: {number(peak)} mm high, {number(p.length_m)} m long."
        pictures.append(gallery.picture(partial(plot.profile, analysis), caption, width="half"))
        if analysis.scanned:
            caption = f"Scan of {name} from above; between the dashed lines lie the points used for the profile."
            pictures.append(gallery.picture(partial(plot.scan, analysis), caption, width="half"))
        if results.estimates is not None and name in results.estimates.roads:
            caption = (
                f"Effective profile of {name}: how far the wheel centre of each axle must rise to keep its tires at "
                f"their static load ({first_load_case(results).name}), tires as radial springs."
            )
            draws = partial(plot.effective_profile, p, results.estimates.roads[name])
            pictures.append(gallery.picture(draws, caption, width="half"))
    return pictures


def representative_run(results: Results) -> RunHistory | None:
    """The run shown first: of the first load case the middle nominal speed, its first repeat."""
    if results.fit is None or not results.fit.histories:
        return None
    histories = {h.file: h for h in results.fit.histories}
    runs = [r for r in results.campaign.bump_runs if r.log.file in histories]
    for load_case in results.campaign.load_cases:
        of_case = [r for r in runs if r.load_case == load_case]
        if of_case:
            speeds = sorted({r.nominal_speed_m_s for r in of_case})
            middle = speeds[len(speeds) // 2]
            chosen = min((r for r in of_case if r.nominal_speed_m_s == middle), key=lambda r: r.repeat)
            return histories[chosen.log.file]
    return results.fit.histories[0]


def run_words(history: RunHistory) -> str:
    """Case, speed found and file of a run in words."""
    return f"{history.case}, driven at {speed(history.speed_m_s)} km/h ({history.file})"


def fit_words(fit: FitResult) -> str:
    """How the least squares ended, in a sentence."""
    how = "Least squares converged" if fit.converged else "Least squares did not converge"
    return f"{how} after {count(fit.iterations, 'iteration')}: {fit.message.rstrip('.')}."


def history_pictures(results: Results, gallery: Gallery) -> tuple[list[Picture], list[Picture]]:
    """Figures 7 and 8 of the paper for the representative run, and all its channels; the page draws the other runs."""
    if results.fit is None:
        return [], []
    shown = []
    if (history := representative_run(results)) is not None:
        axles = sorted({a for a in history.axles if a is not None})
        chosen = tuple(dict.fromkeys((axles[0], axles[-1]))) if axles else ()
        if chosen:
            names = " and ".join(f"axle {a + 1}" for a in chosen)
            caption = (
                f"Measured against simulated, as in Figures 7 and 8 of the paper: suspension deflection and axle "
                f"acceleration of {names}; {run_words(history)}. Below each history: measured minus simulated, and "
                f"{_band_words(history)}."
            )
            shown.append(gallery.picture(partial(plot.suspension_histories, history, chosen), caption))
    of_all = []
    if history is not None:
        of_all.append(gallery.picture(partial(plot.channel_grid, history), f"All channels of {run_words(history)}."))
    return shown, of_all


def _band_words(history: RunHistory) -> str:
    """What the bands of an overlay are."""
    if history.band is None:
        return "the band of 90 % of the scatter that the fit assigns to the channel"
    return (
        "two bands: the darker one holds 90 % of what draws from the posterior simulate for this run, the lighter one "
        "90 % of new readings, posterior and residual scatter together"
    )


def mode_pictures(modes: Sequence[NaturalModes], gallery: Gallery) -> list[Picture]:
    """Mode shapes of the calibrated truck, a figure per load case."""
    pictures = []
    for m in modes:
        caption = (
            f"Mode shapes, {m.load_case.name}: the truck at rest in grey, displaced in colour, travelling to the left; "
            "fore-aft motion is not drawn."
        )
        listed = ", ".join(f"{number(float(f))} Hz" for f in m.frequency_hz)
        pictures.append(gallery.picture(partial(plot.mode_shapes, m), caption, f"{caption} Frequencies: {listed}."))
    return pictures


def loop_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Force-displacement and force-rate curves, for every load case that was driven, where a law is not linear."""
    pictures = []
    for loops in () if results.estimates is None else results.estimates.loops:
        caption = (
            f"Suspension force against extension and against its rate, {loops.load_case}: one cycle of "
            f"{1e3 * loops.amplitude_m:g} mm at {loops.frequency_hz:g} Hz with the least-squares laws; positive pulls "
            "axle and body together, the static load is left out."
        )
        pictures.append(gallery.picture(partial(plot.suspension_loop_pair, loops), caption))
    return pictures


def residual_picture(results: Results, gallery: Gallery) -> list[Picture]:
    """Autocorrelation and spectrum of the residuals, before and after the noise model."""
    fit = results.fit
    if fit is None or np.size(fit.residual_evidence.lag_s) == 0:
        return []
    order = fit.residual_evidence.order
    usual = int(np.median(order)) if order.size else 0
    correlation = (
        "Autocorrelation of the residuals. Outside the grey band neighbouring residuals are not independent; the "
        "intervals of this report are widened for it. Innovations are the parts that an autoregressive model of every "
        f"channel and run cannot predict; its order is chosen by the evidence (median {usual}, largest "
        f"{order.max(initial=0)})."
    )
    spectrum = (
        "Power spectrum of the residuals and of their innovations, mean over channels and runs, 1 for white noise. A "
        "channel gets less weight if its residuals have much power at the frequencies that determine the parameters."
    )
    return [
        gallery.picture(partial(plot.autocorrelation, fit), correlation, width="half"),
        gallery.picture(partial(plot.residual_spectrum, fit), spectrum, width="half"),
    ]


def posterior_pictures(results: Results, gallery: Gallery) -> dict[str, list[Picture]]:
    """Marginals, pairs, traces and correlations of the posterior."""
    posterior = results.posterior
    if posterior is None:
        return {}
    suspension = _suspension_names(results)
    shown = suspension[:_MOST_MARGINALS]
    marginals = partial(plot.marginals, posterior, shown, results.fit)
    corner = partial(plot.corner, posterior, shown[:_MOST_CORNER], results.fit)
    traces = partial(plot.traces, posterior, shown, results.fit)
    correlation = partial(plot.correlation, plot.posterior_correlation(posterior), posterior.names)
    return {
        "marginals": [
            gallery.picture(marginals, "Posterior of k and c per axle against the prior; the bar is the 90 % interval.")
        ],
        "corner": [gallery.picture(corner, "Pairs of k and c: thinned draws, marginals on the diagonal.")],
        "traces": [gallery.picture(traces, "Mean over the walkers, step by step, one line per independent ensemble.")],
        "correlation": [gallery.picture(correlation, "Correlation of all parameters.", width="half")],
    }


def _suspension_names(results: Results) -> tuple[str, ...]:
    assert results.posterior is not None
    names = results.posterior.names
    if results.fit is not None:
        kinds = {p.name: p.quantity for p in results.fit.parameters}
        chosen = [n for q in ("stiffness", "damping") for n in names if kinds.get(n) == q]
        if chosen:
            return tuple(chosen)
    return names[:_MOST_CORNER]


def shrinkage_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Prior against result of every parameter."""
    if results.fit is None:
        return []
    caption = (
        "Every parameter over its prior median, 90 % intervals: grey the prior, coloured by axle what is known after "
        "the data. A cross marks what the data do not determine."
    )
    return [gallery.picture(partial(plot.prior_against_posterior, results.fit, results.posterior), caption)]


def profile_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Profiles that have been asked for."""
    return [
        gallery.picture(
            partial(plot.likelihood_profile, p),
            f"Profile of {p.name}: deviance with all other parameters optimised, and the parabola of the "
            f"covariance; they cross the dotted line at the ends of the 90 % intervals. {p.message}",
            width="half",
        )
        for p in results.profiles
    ]


def advice_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """What one further run or sensor would bring, where that has been asked for."""
    advice = results.advice
    if advice is None:
        return []
    caption = (
        "Expected knowledge of k and c after one further run, after one with one more sensor, and with one declared "
        "mass known exactly: worst and median relative standard deviation. Dotted lines: present knowledge."
    )
    best = min((*advice.runs, *advice.sensors), key=lambda p: advice.worst(p)[1], default=advice.now)
    name, sd = advice.worst(advice.now)
    then, left = advice.worst(best)
    words = f"{caption} Now {name} {percent(sd)} at worst; after {best.label} {then} {percent(left)}."
    return [gallery.picture(partial(plot.next_runs, advice), caption, words)]


def _by_axle(values: np.ndarray) -> str:
    return ", ".join(f"axle {i + 1} {number(float(v))}" for i, v in enumerate(values))


def prediction_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Load ratio against time of every predicted pass, as in Figure 9a of the paper."""
    if results.predictions is None:
        return []
    pictures = []
    for p in results.predictions.passes:
        caption = (
            f"{pass_name(p)}: vertical axle load over static load, as in Figure 9a "
            "of the paper; 1 is the load at rest, 0 a wheel off the ground. Hatched: beyond what the driven runs "
            "reached."
        )
        peaks = _by_axle(p.peak_ratio_q50)
        pictures.append(gallery.picture(partial(plot.load_ratios, p), caption, f"{caption} Peak ratios: {peaks}."))
    return pictures


def sweep_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Peak load ratio against speed, a figure per load case."""
    if results.predictions is None:
        return []
    pictures = []
    for s in results.predictions.sweeps:
        caption = (
            f"{sweep_name(results, s)}: peak dynamic load ratio against speed, with 90 % bands where the posterior has "
            "been sampled. Grey: faster than any run of this load case. Open marks: tire deflection, travel or damper "
            "speed beyond what the driven runs reached. Both are extrapolations."
        )
        fastest = _by_axle(s.peak_ratio.q50[-1])
        words = f"{caption} At {speed(float(s.speed_m_s[-1]))} km/h: {fastest}."
        pictures.append(gallery.picture(partial(plot.load_ratio_against_speed, s), caption, words, width="half"))
    return pictures


def paper_pass_pictures(results: Results, gallery: Gallery) -> list[Picture]:
    """Load ratio and suspension force of the first axle in the predicted passes, Figures 9a and 9b of the paper."""
    pictures = []
    for p in () if results.predictions is None else results.predictions.passes[:_MOST_PASSES]:
        caption = (
            f"{pass_name(p)}: vertical load of axle 1 over its static load, as in Figure 9a of the paper; 0 is a wheel "
            "off the ground. Hatched: beyond what the driven runs reached."
        )
        pictures.append(gallery.picture(partial(plot.load_ratio, p, 0), caption, width="half"))
        if p.suspension_force_N is not None:
            caption = (
                f"{pass_name(p)}: force of spring, damper and friction of axle 1 on the body, as in Figure 9b of the "
                "paper."
            )
            pictures.append(gallery.picture(partial(plot.suspension_force, p, 0), caption, width="half"))
    return pictures
