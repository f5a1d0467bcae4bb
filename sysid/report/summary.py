"""One page to print and sign, as PDF: what was measured, k and c, axle loads, verdict, and which result it is."""

from __future__ import annotations

import io
import textwrap
import unicodedata
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sysid import plot
from sysid.export.identity import Identity
from sysid.export.result_json import result_identity
from sysid.files import write_bytes
from sysid.numbers import count, listing
from sysid.plot.style import styled
from sysid.report import first_screen
from sysid.report.figures import representative_run, run_words
from sysid.report.load_tables import sweep_name
from sysid.report.verdict import verdict
from sysid.results import Results
from sysid.results.headline import peak_loads, static_loads_N
from sysid.wording import plain_line

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes

#: A4 [in]. What is drawn lies so far from its upper and lower edges that the page prints on Letter too, which is 18 mm
#: shorter, and 6 mm wider.
WIDTH_IN, HEIGHT_IN = 210.0 / 25.4, 297.0 / 25.4
_SIDE, _END = 0.75, 0.85
_WITHIN = WIDTH_IN - 2.0 * _SIDE
_TONES = {"good": ("#e3f4e8", "#17663a"), "caution": ("#fdf3e1", "#8a5a00"), "stop": ("#fde8e4", "#a02010")}
_INK, _MUTED = "#1f2933", "#616e7c"
_MOST_REASONS = 3
#: Height of the lines for name, date and signature with room for a hand above them, and of the least picture [in].
_FOOT_IN, _LEAST_PICTURE_IN = 1.0, 0.7


@dataclass
class _Page:
    """A figure that is filled from the top: `top` is the distance from the upper edge [in]."""

    figure: Figure
    top: float = _END

    def text(
        self,
        x_in: float,
        words: str,
        size: float = 9.0,
        color: str = _INK,
        weight: str = "normal",
        family: str = "DejaVu Sans",
    ) -> None:
        place = x_in / WIDTH_IN, 1.0 - self.top / HEIGHT_IN
        self.figure.text(*place, words, fontsize=size, color=color, weight=weight, family=family, va="top")

    def axes(self, left_in: float, width_in: float, height_in: float, above_in: float = 0.0) -> Axes:
        low = 1.0 - (self.top + above_in + height_in) / HEIGHT_IN
        return self.figure.add_axes((left_in / WIDTH_IN, low, width_in / WIDTH_IN, height_in / HEIGHT_IN))


@styled
def summary_pdf(results: Results) -> bytes:
    """The page as PDF: text stays text, figures are drawn as lines; the same bytes for the same results."""
    identity = result_identity(results)
    figure = plot.figure(WIDTH_IN, HEIGHT_IN, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    page = _Page(figure)
    unseen = _Unseen()
    _head(page, results, unseen)
    _verdict(page, results, unseen)
    _truck(page, results)
    _pictures(page, results)
    _signature(page, results, identity, unseen)
    stream = io.BytesIO()
    date = datetime.fromisoformat(identity.date) if identity.date else None
    about: dict[str, Any] = {
        "Title": plain_line(results.campaign.title),
        "Subject": identity.line,
        "Creator": "sysid",
        "CreationDate": date,
    }
    with mpl.rc_context({"pdf.fonttype": 42}):
        figure.savefig(stream, format="pdf", metadata=about)
    return stream.getvalue()


def write_summary(results: Results, path: Path) -> None:
    """Write `summary.pdf` to `path`, complete or not at all."""
    write_bytes(path, summary_pdf(results))


class _Unseen:
    """Takes names onto the page, and remembers whether any has characters that its font cannot write."""

    def __init__(self) -> None:
        self.any = False

    def __call__(self, text: str, longest: int = 80) -> str:
        # Letters that join, or run to the left, would stand in the wrong order and shape.
        plain = "".join("\u4e00" if unicodedata.bidirectional(c) in ("R", "AL") else c for c in plain_line(text))
        shown = plot.label(plain, longest)
        self.any = self.any or "\u25af" in shown
        return shown


def _head(page: _Page, results: Results, name: _Unseen) -> None:
    details, vehicle = results.campaign.details, results.campaign.vehicle
    page.text(_SIDE, "SUSPENSION STIFFNESS AND DAMPING, AXLE LOADS", 7.5, _MUTED)
    page.top += 0.16
    page.text(_SIDE, name(results.campaign.title, 62), 15.0, weight="bold")
    page.top += 0.36
    runs, drops = len(results.campaign.bump_runs), len({d.log.file for d in results.campaign.plank_drops})
    pairs = [
        ("Vehicle", name(" · ".join(t for t in (vehicle.name, details.vehicle_id) if t), 52)),
        ("Tests", ", ".join([count(drops, "plank drop"), count(runs, "bump run")])),
        ("Date", details.date or ""),
        ("Place", name(details.place or "", 40)),
        ("Operator", name(details.operator or "", 40)),
        ("Load cases", name(listing(list(results.campaign.load_cases_in_use)), 60)),
    ]
    for row in range(0, len(pairs), 2):
        for side, (head, text) in enumerate(pairs[row : row + 2]):
            left = _SIDE + side * 0.5 * _WITHIN
            page.text(left, head, 8.0, _MUTED)
            page.text(left + 0.75, text or "\u2014", 8.5)
        page.top += 0.19
    page.top += 0.1


def _verdict(page: _Page, results: Results, name: _Unseen) -> None:
    said = verdict(results)
    pale, strong = _TONES[said.tone]
    reasons = [line for r in said.use[:_MOST_REASONS] for line in textwrap.wrap(name(r, 600), 118)][:6]
    more = len(said.use) - _MOST_REASONS
    if more > 0:
        reasons.append(f"{count(more, 'more reason')} in the report.")
    if said.loads:
        loads = said.loads
        answer = f"Can the axle loads be used? {loads.words}. {loads.largest} {loads.computed} {loads.sentences}"
        reasons += textwrap.wrap(name(answer, 600), 118)
    height = 0.42 + 0.145 * len(reasons)
    ax = page.axes(_SIDE, _WITHIN, height)
    ax.set_axis_off()
    ax.add_patch(Rectangle((0.0, 0.0), 1.0, 1.0, transform=ax.transAxes, fc=pale, ec=strong, lw=0.8))
    page.top += 0.1
    synthetic = "   (synthetic data)" if said.synthetic else ""
    page.text(_SIDE + 0.12, f"Can k and c be used? {said.answer}.{synthetic}", 10.5, strong, "bold")
    page.figure.text(
        (WIDTH_IN - _SIDE - 0.12) / WIDTH_IN, 1.0 - page.top / HEIGHT_IN, said.badge, fontsize=8.0, color=strong,
        weight="bold", ha="right", va="top",
    )  # fmt: skip
    page.top += 0.24
    for line in reasons:
        page.text(_SIDE + 0.12, line, 7.5)
        page.top += 0.145
    page.top += 0.2


def _truck(page: _Page, results: Results) -> None:
    rows = first_screen.truck_rows(results)
    if not rows.texts:
        return
    height = plot.truck_height(results.campaign.vehicle, rows.texts, _WITHIN)
    ax = page.axes(_SIDE, _WITHIN, height)
    plot.truck(results.campaign.vehicle, rows.texts, rows.highest, ax)
    page.top += height + 0.05
    for line in textwrap.wrap(rows.caption, 128):
        page.text(_SIDE, plot.label(line, 140), 7.0, _MUTED)
        page.top += 0.13
    page.top += 0.12


def _pictures(page: _Page, results: Results) -> None:
    """Measured over simulated on the left, loads on the right."""
    gap, above, below = 0.75, 0.25, 0.75
    width = 0.5 * (_WITHIN - gap)
    height = min(HEIGHT_IN - _END - _FOOT_IN - page.top - above - below, 2.0)
    if height < _LEAST_PICTURE_IN:
        return
    words = []
    history = representative_run(results)
    if history is not None:
        column = max(
            range(len(history.columns)),
            key=lambda k: (history.kinds[k] == "suspension_deflection", float(np.nanstd(history.simulated[k]))),
        )
        plot.overlay(history, history.columns[column], page.axes(_SIDE + 0.4, width, height, above), show_bands=False)
        words.append(f"Left: measured and simulated, {run_words(history)}.")
    sweeps = () if results.predictions is None else results.predictions.sweeps
    passes = () if results.predictions is None else results.predictions.passes
    place = _SIDE + 0.4 + width + gap
    if sweeps:
        sweep = max(sweeps, key=lambda s: float(np.nanmax(static_loads_N(results, s) * s.peak_ratio.q50)))
        ax = page.axes(place, width - 0.4, height, above)
        plot.axle_load_against_speed(sweep, static_loads_N(results, sweep), ax)
        # The keys stand above the curves, wherever these rise.
        ax.set_ylim(0.0, 1.3 * ax.get_ylim()[1])
        ax.legend(loc="upper left", ncols=2, fontsize=5.5)
        words.append(f"Right: peak axle load against speed, {sweep_name(results, sweep)}.")
    elif passes:
        highest = max(passes, key=lambda p: float(np.max(p.static_load_N * p.peak_ratio_q50)))
        axle = int(np.argmax(highest.static_load_N * highest.peak_ratio_q50))
        plot.load_ratio(highest, axle, page.axes(place, width - 0.4, height, above))
        words.append(f"Right: axle {axle + 1} in the pass {peak_loads(highest)[axle].pass_name}.")
    if not words:
        return
    page.top += above + height + 0.45
    for line in textwrap.wrap(plain_line(" ".join(words)), 128):
        page.text(_SIDE, plot.label(line, 140), 7.0, _MUTED)
        page.top += 0.13


def _signature(page: _Page, results: Results, identity: Identity, name: _Unseen) -> None:
    """At the foot: lines for name, date and signature, and which result this is."""
    page.top = HEIGHT_IN - _END - 0.55
    for left, width, words in ((0.0, 2.4, "Name"), (2.6, 1.4, "Date"), (4.2, _WITHIN - 4.2, "Signature")):
        begin, end = (_SIDE + left) / WIDTH_IN, (_SIDE + left + width) / WIDTH_IN
        height = 1.0 - page.top / HEIGHT_IN
        page.figure.add_artist(mpl.lines.Line2D([begin, end], [height, height], color=_INK, lw=0.8))
        page.figure.text(begin, height - 0.06 / HEIGHT_IN, words, fontsize=7.0, color=_MUTED, va="top")
    page.top += 0.3
    version = results.provenance.get("versions", {}).get("sysid", "")
    made = ", ".join(t for t in (f"sysid run {identity.run}", identity.date, f"version {version}") if t)
    lines = [f"{made}. Everything else is in report.html.", f"SHA-256 of the result: {identity.result_sha256}"]
    if name.any:
        lines[0] += " \u25af: letters that this page cannot write; they are in report.html."
    # In a type of one width: letters of others may join, and nobody could compare the hash.
    for line, family in zip(lines, ("DejaVu Sans", "DejaVu Sans Mono"), strict=True):
        page.text(_SIDE, line, 6.2, _MUTED, family=family)
        page.top += 0.12
