"""The section "Coverage" of docs/evidence/statistics.md from the replicates that are there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import binom, chi2

from studies.coverage.shards import Record, collect

HEADING = "## Coverage"
#: Draws that the truth is ranked among, and bins of the ranks.
DRAWS, BINS = 99, 20
LIMIT = 0.001

INTRODUCTION = """\
Do the intervals hold what they promise? Data are simulated from a truth that is known, analysed by the same code as
measured ones, and the truth is ranked among 99 draws of the result (S. Talts et al., Validating Bayesian inference
algorithms with simulation-based calibration, 2018, arXiv:1804.06788). Ranks should be uniform (chi-square over 20
bins), and 50 and 90 % intervals should hold the truth in 50 and 90 % of the replicates. *Within limits* says yes if p
is above 0.001 over the number of quantities, and if both shares are as near to 50 and 90 % as chance leaves them
(99.9 % range over all quantities). The tables are written by

    python -m studies.coverage --output build/coverage --document docs/evidence/statistics.md

(`make coverage`), which keeps every replicate in a file of its own, goes on where it was stopped, and leaves out
replicates of other code.""".splitlines()


def uniform_probability(ranks: np.ndarray) -> float:
    """Probability of a larger chi-square of ranks 0 to 99 over 20 bins, were they uniform."""
    counts = np.histogram(ranks, bins=BINS, range=(0, DRAWS + 1))[0]
    expected = ranks.size / BINS
    return float(chi2.sf(((counts - expected) ** 2 / expected).sum(), BINS - 1))


def held(ranks: np.ndarray, share: float) -> float:
    """How often the central interval of a share of the draws holds the truth."""
    tail = 0.5 * (1.0 - share) * (DRAWS + 1)
    return float(np.mean((ranks >= tail) & (ranks < DRAWS + 1 - tail)))


def binomial_bound(share: float, count: int, quantities: int) -> tuple[float, float]:
    """Range of an observed share that chance leaves with 99.9 %, Bonferroni over the quantities."""
    tail = 0.5 * LIMIT / quantities
    return float(binom.ppf(tail, count, share)) / count, float(binom.isf(tail, count, share)) / count


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def rank_table(records: Sequence[Record]) -> list[str]:
    """One row per quantity and one for all."""
    by_name: dict[str, list[int]] = {}
    for record in records:
        for entry in record["entries"]:
            by_name.setdefault(entry["name"], []).append(entry["rank"])
    rows = []
    for name, values in by_name.items():
        ranks = np.array(values)
        bounds = [binomial_bound(share, ranks.size, len(by_name)) for share in (0.5, 0.9)]
        within = all(a <= held(ranks, s) <= b for s, (a, b) in zip((0.5, 0.9), bounds, strict=True))
        p = uniform_probability(ranks)
        verdict = "yes" if within and p > LIMIT / len(by_name) else "no"
        rows.append(
            (
                f"`{name}`",
                str(ranks.size),
                f"{100 * held(ranks, 0.5):.0f}",
                f"{100 * held(ranks, 0.9):.0f}",
                f"{p:.3f}",
                verdict,
            )
        )
    every = np.concatenate([np.array(v) for v in by_name.values()])
    rows.append(("all", str(every.size), f"{100 * held(every, 0.5):.1f}", f"{100 * held(every, 0.9):.1f}", "", ""))
    return _table(("quantity", "ranks", "50 % hold %", "90 % hold %", "p uniform", "within limits"), rows)


def _holds(entry: Record, which: str) -> bool:
    low, _, high = entry[which]
    return bool(low <= entry["truth"] <= high)


def misfit_tables(records: Sequence[Record]) -> list[str]:
    """Coverage by kind of quantity, by vehicle, and by the physics behind the data; and how many laws were false."""
    good = [r for r in records if r["failed"] is None]
    entries = [e for r in good for e in r["entries"]]
    rows = []
    for kind in dict.fromkeys(e["kind"] for e in entries):
        rows.append(_misfit_row(kind, [e for e in entries if e["kind"] == kind]))
    for vehicle in dict.fromkeys(r["vehicle"] for r in good):
        rows.append(_misfit_row(vehicle, [e for r in good if r["vehicle"] == vehicle for e in r["entries"]]))
    rows.append(_misfit_row("all", entries))
    columns = (
        "90 % interval of",
        "entries",
        "holds %",
        "median half-width %",
        "normal approximation: holds %",
        "half-width %",
    )
    lines = _table(columns, rows)
    held = ("k held", "c held", "peaks held", "largest error of k, c, peaks %")
    head = ("true physics", "campaigns", "report says so", "elements found", *held)
    rows = [_physics_row(name, [r for r in good if r["physics"] == name]) for name in _distinct(good, "physics")]
    lines += _table(head, rows)
    linear = [r for r in good if r["linear"]]
    false = sum(r["false_laws"] for r in linear)
    lines += [
        f"Elements that are not there were found in {false} of {len(linear)} campaigns of linear suspensions.",
        "",
        f"In {sum(map(_mostly_missed, good))} of {len(good)} campaigns fewer than half of the intervals hold.",
        "",
    ]
    return lines


def _mostly_missed(record: Record) -> bool:
    return sum(_holds(e, "reported") for e in record["entries"]) < 0.5 * len(record["entries"])


def _distinct(records: Sequence[Record], key: str) -> list[str]:
    return list(dict.fromkeys(r[key] for r in records))


def _physics_row(name: str, records: Sequence[Record]) -> tuple[str, ...]:
    entries = [e for r in records for e in r["entries"]]
    said = f"{sum(r['said'] for r in records)} of {len(records)}"
    laws = "; ".join(_distinct([{"laws": ", ".join(r["laws"]).replace("_", " ") or "linear"} for r in records], "laws"))
    held, worst = [], []
    for kind in ("stiffness", "damping", "peak"):
        of = [e for e in entries if e["kind"] == kind]
        held.append(f"{sum(_holds(e, 'reported') for e in of)} of {len(of)}")
        worst.append(f"{100.0 * max(abs(e['reported'][1] / e['truth'] - 1.0) for e in of):.1f}")
    return (name, str(len(records)), said, laws, *held, ", ".join(worst))


def _misfit_row(name: str, entries: Sequence[Record]) -> tuple[str, ...]:
    cells = [name, str(len(entries))]
    for which in ("reported", "normal"):
        half = [50.0 * (e[which][2] - e[which][0]) / e[which][1] for e in entries]
        cells += [f"{100 * np.mean([_holds(e, which) for e in entries]):.0f}", f"{np.median(half):.1f}"]
    return tuple(cells)


def failures(records: Sequence[Record]) -> list[str]:
    """How many replicates failed."""
    failed = sum(r.get("failed") is not None for r in records)
    return [f"{failed} of {len(records)} replicates failed.", ""]


def section(folder: Path) -> list[str]:
    """Lines of the section."""
    lines = [HEADING, "", *INTRODUCTION, ""]
    drops, bump, masses, rough, misfit = (
        collect(folder, s).records for s in ("drops", "bump", "masses", "rough", "misfit")
    )
    if drops:
        lines += ["### One axle dropped off a plank", "", *_DROPS, "", *rank_table(drops), *failures(drops)]
    if bump:
        lines += ["### A two-axle truck over a bump", "", *_BUMP, "", *rank_table(bump), *failures(bump)]
    if masses:
        lines += ["### The same with masses that are off", "", *_MASSES, "", *rank_table(masses), *failures(masses)]
    if rough:
        said = sum(bool(r.get("said")) for r in rough)
        lines += ["### The same with rough noise", "", *_ROUGH, "", *rank_table(rough), *failures(rough)]
        lines += [f"{said} of {len(rough)} results warn that the model does not explain the data.", ""]
    if misfit:
        lines += ["### Whole campaigns with other physics than the model's", "", *_MISFIT, "", *misfit_tables(misfit)]
        lines += failures(misfit)
    return lines


def write(folder: Path, document: Path) -> None:
    """Replace the section in a document, or add it at its end."""
    text = document.read_text(encoding="utf-8") if document.exists() else ""
    before, _, rest = text.partition(f"{HEADING}\n")
    after = rest[rest.index("\n## ") + 1 :] if "\n## " in rest else ""
    parts = [before.rstrip(), "\n".join(section(folder)).rstrip(), after.rstrip()]
    document.write_text("\n\n".join(p for p in parts if p) + "\n", encoding="utf-8", newline="\n")


_DROPS = """\
k and c from lognormal priors, masses and tire off by their tolerances, the exact motion of a quarter car read every
5 ms with 0.25 mm of noise. Draws: the estimate's normal in log space.""".splitlines()
_BUMP = """\
Truth from the priors, two runs of 2.8 s with six sensors, masses as declared; least squares and log-density of the
product, draws by its sampler (emcee) with default options. A replicate that has not converged counts as failed, and its
ranks count too.""".splitlines()
_MASSES = """\
Masses, inertia, height and axle loads differ from the declared ones by their default tolerances. The fit estimates them
and integrates them out.""".splitlines()
_ROUGH = """\
Noise that is correlated from one reading to the next (0.6), 1 % of readings off by ten times the noise. Correlation and
tails are estimated from the residuals, and intervals come out somewhat wider than necessary.""".splitlines()
_MISFIT = """\
The default path of `run`: laws undeclared, the posterior sampled, passes predicted from its draws. Vehicles take
turns: the six-axle tractor and lowboy of `examples/linear_truck` and a three-axle truck with an air-sprung tandem,
empty and loaded, one run per case. In every campaign k, c and tires come from their priors, masses, heights and axle
loads are off within their tolerances, and noise is correlated (0.3); contact, suspensions, frames, roads or loads are
others as the second table says, and nothing of that is declared. Soft and stiff spokes have exponents 0.2 below and
0.3 above the one that goes with the tire's load law; a rocker joins the tandem of the first body; the frame of the
last body bends; axle loads that are 1 % off have that standard deviation beside their tolerances; the rough road has
1e-6 m³ at 0.1 cycles per metre; outliers are six times the noise. "Report says so": a part that nobody declared is
named, or the report says that the model does not explain the data. Drops are replaced by the prior that they would be
the median of. Peaks are peak load ratios, over weighed loads, of passes nobody drove, half-widths medians. The normal
approximation has the same mode and covariance, without sampling. Seeds were drawn after the last change of the
method; it was developed on others (3001 to 3006, 20261122, 20261123). Readings come from this program's integrator,
which other engines check ([accuracy.md](accuracy.md)).""".splitlines()
