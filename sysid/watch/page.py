"""The page of a test day: one screen that can be read from two metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from sysid.report.skeleton import render_page, render_part
from sysid.watch.knowledge import axle_states
from sysid.watch.last_run import LastRun
from sysid.watch.records import AxleState, DayReport, KnownValue, LogVerdict, StopRule
from sysid.wording import shorten

if TYPE_CHECKING:
    from sysid.campaign.vehicle_records import Vehicle

#: Sign, word and colour of what is known of an axle; the sign tells it without the colour.
STATES: dict[AxleState, tuple[str, str, str]] = {
    "known": ("\u25cf", "known", "#7ddfb0"),
    "wide": ("\u25d0", "too wide", "#ffc94d"),
    "unknown": ("\u25cb", "not known", "#ffffff"),
}
#: Sign and words of the answers to a log.
ANSWERS = {
    "good": ("\u2713", "good"),
    "look": ("!", "look at this"),
    "repeat": ("\u2717", "REPEAT THIS TEST"),
    "unlisted": ("?", "not in the campaign file"),
}
#: Logs and sentences that one screen shows.
_LOGS, _SENTENCES = 4, 3


@dataclass(frozen=True)
class _Row:
    """One axle on the page, in one load case or in all."""

    axle: int
    name: str
    load_case: str
    stiffness: str
    damping: str
    sign: str
    word: str
    state: AxleState


def day_page() -> str:
    """The whole page; what it shows is in :func:`day_part`, for which its script asks."""
    return render_page(
        "day.html", {"page_title": "Test day", "preview": False, "served": True}, "day", "day", connects=True
    )


def day_part(
    report: DayReport | None,
    last: Sequence[LogVerdict],
    vehicle: Vehicle | None,
    rule: StopRule,
    run: LastRun | None = None,
) -> str:
    """What the page shows of a day.

    Parameters
    ----------
    report : None before the first one. last : the logs that landed last.
    vehicle : to draw; None as long as it is not known. run : to show; None before a fit.
    """
    if report is None:
        return render_part("day_part.html", {"report": None})
    states = axle_states(report.known, rule)
    wrong = sorted((v for v in report.logs if v.answer != "good"), key=_how_bad)
    shown = sorted((v for v in last if v.answer != "good"), key=_how_bad) or list(last)
    return render_part(
        "day_part.html",
        {
            "report": report,
            "headline": _headline(report),
            "truck": _truck(vehicle, states),
            "run": None if run is None else _run(run),
            "rows": [
                _Row(
                    row.axle,
                    "" if before is not None and before.axle == row.axle else shorten(row.name, 24),
                    shorten(row.load_case or "", 20),
                    _value(row.stiffness),
                    _value(row.damping),
                    *STATES[states[row.axle]][:2],
                    states[row.axle],
                )
                for before, row in zip((None, *report.known), report.known, strict=False)
            ],
            "last": [(v, *ANSWERS[v.answer]) for v in shown[:_LOGS]],
            "wrong": [(v, *ANSWERS[v.answer]) for v in wrong if v not in shown][:_LOGS],
            "good": sum(v.answer == "good" for v in report.logs),
            "there": sum(test.there for test in report.planned),
            "older": any(v is not None and v.older for row in report.known for v in (row.stiffness, row.damping)),
            "missing": () if report.enough else report.missing[:_SENTENCES],
            "next_tests": () if report.enough else report.next_tests[1 : 1 + _SENTENCES],
        },
    )  # fmt: skip


def _how_bad(verdict: LogVerdict) -> int:
    return ("repeat", "look", "unlisted", "good").index(verdict.answer)


def _headline(report: DayReport) -> str:
    """The one thing to do now."""
    if report.enough:
        return "Enough: stop."
    repeat = [v for v in report.logs if v.answer == "repeat"]
    if repeat:
        return f"Repeat: {repeat[-1].test or shorten(repeat[-1].file, 60)}"
    to_come = [test for test in report.planned if not test.there]
    if to_come:
        return f"Next: {to_come[0].words}"
    if report.computing:
        return "All tests are there: wait for the result."
    return report.next_tests[0] if report.next_tests else "Waiting for the next log."


def _value(value: KnownValue | None) -> str:
    if value is None:
        return "\u2013"
    return f"{value.value / 1e3:,.4g} \u00b1 {100.0 * value.half_width:.2g} %" + ("*" if value.older else "")


def _truck(vehicle: Vehicle | None, states: dict[int, AxleState]) -> Markup | None:
    """The vehicle to scale, its hubs in the colours of what is known; nothing before a vehicle is known."""
    if vehicle is None:
        return None
    from sysid import plot

    found: list[AxleState] = [states.get(i + 1, "unknown") for i in range(len(vehicle.axles))]
    words = [f"{STATES[s][0]} {STATES[s][1]}" for s in found]
    axes = plot.truck(vehicle, [("", words)], hubs=[STATES[s][2] for s in found])
    text = "; ".join(f"axle {i + 1}: {STATES[s][1]}" for i, s in enumerate(found))
    return Markup(plot.svg_element(plot.figure_of(axes), "truck", f"The vehicle from the side. {text}."))


def _run(run: LastRun) -> tuple[Markup, str]:
    """Measured and simulated signal of a run, and what to see in it."""
    from sysid import plot

    axes = plot.overlay(run.history, run.column, plot.figure(4.2, 2.3).subplots(), show_bands=False)
    words = (
        f"{shorten(run.history.file, 60)}: the channel that the fit meets least, by {run.misfit:.2g} times the noise "
        "before the bump."
    )
    return Markup(plot.svg_element(plot.figure_of(axes), "run", f"Measured and simulated: {words}")), words
