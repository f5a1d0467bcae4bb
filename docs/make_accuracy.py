"""Write a page of docs: results of a finished output folder against the truth of a synthetic campaign.

    python docs/make_accuracy.py [OUTPUT] [CAMPAIGN_FOLDER]

OUTPUT is the folder of a `calibrate.py run` on the campaign (default: output), CAMPAIGN_FOLDER holds `campaign.toml`
and `truth.toml`: `data` (the default, for docs/evidence/accuracy.md) or `examples/linear_truck` (for accuracy-linear.md
there).
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
METHODS = ("paper", "corrected", "free_decay", "model")
#: Extension rate [m/s] at which a damper's c is stated, as a secant.
STATED_RATE_M_S = 0.5
SUSPENSION = ("stiffness", "damping")
TIRE = {"tire_stiffness": 0, "tire_damping": 1}
KINDS = {
    "suspension_deflection": "suspension deflection",
    "axle_acceleration": "axle acceleration",
    "body_acceleration": "frame acceleration",
}
MISSING = "–"

INTRODUCTION = """\
Written by `python docs/make_accuracy.py OUTPUT FOLDER` from the results of `calibrate.py run FOLDER` and its
`truth.toml`; not edited by hand. The campaign is **synthetic** (`README.md` of its folder): its histories come from
another, more detailed model, so errors of the model's form are in these figures. Masses, inertias and heights in its
campaign file are exact, so errors of those are not. One campaign says little about others, and this one was seen while
the methods were made. c is the secant at 0.5 m/s, mean of rebound and compression.""".splitlines()
#: Heading and file of the page by the campaign's folder.
PAGES = {
    "data": ("Accuracy on the shipped campaign", "evidence/accuracy.md"),
    "linear_truck": ("Accuracy on the linear truck", "evidence/accuracy-linear.md"),
}

READING = """\
The values are posterior medians, or least squares where nothing was sampled. Honest 90 % intervals hold the truth nine
times in ten, over many campaigns ([statistics.md](statistics.md)); what is in them stands in
[results.md](../results.md).""".splitlines()


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Lines of a Markdown table, first column to the left, the others to the right."""
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def percent(value: float, truth: float) -> str:
    """Signed error in per cent of the truth."""
    return f"{100.0 * (value / truth - 1.0):+.1f}"


def inside(quantiles: dict[str, float], truth: float) -> bool:
    """Whether the 90 % interval holds the truth."""
    return quantiles["q05"] <= truth <= quantiles["q95"]


def band(quantiles: dict[str, float] | None, scale: float, digits: int) -> str:
    """Median and 90 % interval, a dash before sampling."""
    if quantiles is None or quantiles["q05"] is None:
        return MISSING
    middle, low, high = (quantiles[q] / scale for q in ("q50", "q05", "q95"))
    return f"{middle:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def true_stiffness(axle: dict[str, Any], load_case: str | None) -> float:
    """True k [N/m] of an axle, in a load case where it depends on that."""
    return float(axle.get(f"suspension_stiffness_{load_case}_N_per_m", axle["suspension_stiffness_N_per_m"]))


def true_damping(axle: dict[str, Any]) -> float:
    """True c [N s/m]: the secant of c v r / (1 + |v| / v_s) at the stated rate, mean of both directions."""
    ratio = 0.5 * (axle.get("damper_bump_ratio", 1.0) + axle.get("damper_rebound_ratio", 1.0))
    throttled = 1.0 + STATED_RATE_M_S / axle.get("damper_saturation_m_s", float("inf"))
    return float(axle["suspension_damping_N_s_per_m"] * ratio / throttled)


def suspension_pairs(result: dict[str, Any], truth: dict[str, Any]) -> list[tuple[dict[str, Any], float]]:
    """k and c of every axle with their true values."""
    rows = []
    for p in result["parameters"]:
        if p["quantity"] in SUSPENSION:
            axle = truth["axle"][p["axle"] - 1]
            rows.append(
                (p, true_stiffness(axle, p["load_case"]) if p["quantity"] == "stiffness" else true_damping(axle))
            )
    return rows


def tire_pairs(result: dict[str, Any], truth: dict[str, Any]) -> list[tuple[dict[str, Any], float]]:
    """Tangent values of every tire with their true values at the first load case's load."""
    first = next(iter(truth["modes"]))
    return [
        (p, truth["axle"][p["axle"] - 1][f"tire_tangent_{first}"][TIRE[p["quantity"]]])
        for p in result["parameters"]
        if p["quantity"] in TIRE
    ]


def friction_pairs(result: dict[str, Any], truth: dict[str, Any]) -> list[tuple[dict[str, Any], float]]:
    """Friction of every axle that was found to have some, with its true value in the first load case."""
    key = f"friction_breakaway_{next(iter(truth['modes']))}_N"
    return [
        (p, truth["axle"][p["axle"] - 1].get(key, 0.0)) for p in result["parameters"] if p["quantity"] == "friction"
    ]


def best(parameter: dict[str, Any]) -> float:
    """Posterior median, or the least-squares value before sampling."""
    posterior = parameter["posterior"]
    return parameter["least_squares"]["value"] if posterior is None else posterior["q50"]


def parameter_table(rows: list[tuple[dict[str, Any], float]], unit: str, digits: int) -> list[str]:
    """Truth, least squares and posterior of the parameters in thousands of their SI unit."""
    lines = []
    for p, true in rows:
        fit, posterior = p["least_squares"], p["posterior"]
        lines.append(
            [
                f"`{p['name']}`",
                f"{true / 1e3:.{digits}f}",
                f"{fit['value'] / 1e3:.{digits}f} ± {fit['sd'] / 1e3:.{digits}f}",
                percent(fit["value"], true) if true else MISSING,
                band(posterior, 1e3, digits),
                MISSING if posterior is None or not true else percent(posterior["q50"], true),
                MISSING if posterior is None else "yes" if inside(posterior, true) else "no",
            ]
        )
    head = ("", f"true {unit}", "least squares ± sd", "error %", "posterior median (90 %)", "error %", "truth inside")
    return table(head, lines)


def drop_table(result: dict[str, Any], truth: dict[str, Any]) -> list[str]:
    """Pooled drop values over the true ones, by axle and method."""
    pooled = {(d["axle"], d["method"]): d for d in result["drops"] if d["file"] is None}
    rows = []
    for number, axle in enumerate(truth["axle"], start=1):
        cells = [f"{number} {axle['name']}"]
        for quantity in SUSPENSION:
            for method in METHODS:
                drop = pooled.get((number, method))
                true = (
                    true_stiffness(axle, drop["load_case"]) if drop and quantity == "stiffness" else true_damping(axle)
                )
                cells.append(f"{drop[quantity] / true:.2f}" if drop and drop["usable"] else MISSING)
        rows.append(cells)
    return table(("axle", *(f"{s} {m}" for s in "kc" for m in METHODS)), rows)


def prediction_rows(result: dict[str, Any], truth: dict[str, Any]) -> list[tuple[dict[str, Any], float]]:
    """Every predicted pass and axle with its true peak load ratio."""
    true = {(p["load_case"], float(p["speed_km_h"])): p["peak_tire_force_over_static"] for p in truth["prediction"]}
    return [(p, true[p["load_case"], float(p["speed_km_h"])][p["axle"] - 1]) for p in result["predictions"]]


def prediction_table(rows: list[tuple[dict[str, Any], float]]) -> list[str]:
    """Peak dynamic load ratios against the true ones."""
    lines = []
    for p, true in rows:
        ratio = p["peak_dynamic_load_ratio"]
        lines.append(
            [
                f"{p['load_case']} {p['speed_km_h']:g} km/h, axle {p['axle']}",
                f"{true:.3f}",
                f"{ratio['q50']:.3f}" if ratio["q05"] is None else band(ratio, 1.0, 3),
                percent(ratio["q50"], true),
                MISSING if ratio["q05"] is None else "yes" if inside(ratio, true) else "no",
            ]
        )
    return table(("pass", "true", "median (90 %)", "error %", "truth inside"), lines)


def agreement_table(result: dict[str, Any], sensors: dict[str, Any]) -> list[str]:
    """NRMSE of all runs by kind of channel."""
    rows = []
    for kind, words in KINDS.items():
        values = [v["nrmse"] for v in result["validation"] if sensors[v["channel"]]["kind"] == kind]
        values = sorted(v for v in values if v is not None)
        if values:
            rows.append([words, str(len(values)), f"{100 * median(values):.1f}", f"{100 * values[-1]:.1f}"])
    return table(("channels", "records", "median NRMSE %", "largest %"), rows)


def spread(rows: Iterable[tuple[float, float]]) -> str:
    """Median and largest absolute error in per cent."""
    errors = [100.0 * abs(value / true - 1.0) for value, true in rows]
    middle, largest = (f"{e:.1f}" if e >= 1.0 else f"{e:.2g}" for e in (median(errors), max(errors)))
    return f"median {middle} %, largest {largest} %"


def coverage(rows: list[tuple[dict[str, Any], float]]) -> str:
    """How many 90 % intervals hold the truth, and how far off the worst value is in its own standard deviations."""
    sampled = [(p["posterior"], true) for p, true in rows if p["posterior"] is not None]
    if not sampled:
        return "not sampled"
    held = sum(inside(q, true) for q, true in sampled)
    worst = max(abs(q["q50"] - true) / q["sd"] for q, true in sampled)
    return f"{held} of {len(sampled)}, the worst median is {worst:.1f} sd off"


def origin(result: dict[str, Any]) -> str:
    """Which code made the results, and on what kind of machine this page is written."""
    code = f"sysid {result['versions']['sysid']}"
    git = ["git", "-C", str(ROOT), "log", "-1", "--format=%h"]
    found = subprocess.run(git, capture_output=True, text=True, check=False)
    if found.returncode == 0:
        code += f", commit {found.stdout.strip()}"
    return f"Made by {code}, on {os.cpu_count()} cores ({platform.machine()})."


def document(heading: str, result: dict[str, Any], campaign: dict[str, Any], truth: dict[str, Any]) -> str:
    """The text of the page."""
    suspension, friction = suspension_pairs(result, truth), friction_pairs(result, truth)
    by_quantity = {q: [(p, t) for p, t in suspension if p["quantity"] == q] for q in SUSPENSION}
    passes = prediction_rows(result, truth)
    speed = {r["file"]: r["true_speed_m_s"] for r in truth["bump_run"]}
    # The truth is the mean over the record; parameters are the speed at axle 1 and its change until the last axle.
    first, change = (
        {p["run"]: p["least_squares"]["value"] for p in result["parameters"] if p["quantity"] == quantity}
        for quantity in ("speed", "speed_change")
    )
    speeds = [(value * (1.0 + 0.5 * change.get(run, 0.0)), speed[run]) for run, value in first.items()]
    seconds = result["timings"]
    summary = [
        ["stiffness k", spread((best(p), t) for p, t in by_quantity["stiffness"]), coverage(by_quantity["stiffness"])],
        ["damping c", spread((best(p), t) for p, t in by_quantity["damping"]), coverage(by_quantity["damping"])],
        ["speeds of the runs", spread(speeds), MISSING],
    ]
    if passes:
        ratios = [(p["peak_dynamic_load_ratio"], t) for p, t in passes]
        sampled = [(q, t) for q, t in ratios if q["q05"] is not None]
        held = f"{sum(inside(q, t) for q, t in sampled)} of {len(sampled)}" if sampled else "not sampled"
        summary.append(["peak load ratios of passes nobody drove", spread((q["q50"], t) for q, t in ratios), held])
    # Parts of a stage stand as "stage: part".
    whole = {name: value for name, value in seconds.items() if value is not None and value >= 1 and ": " not in name}
    stages = ", ".join(f"{name} {value:.0f} s" for name, value in whole.items())
    lines = [
        f"# {heading}",
        "",
        *INTRODUCTION,
        "",
        f"Status {result['status'].replace('_', ' ')}, seed {result['seed']}. {origin(result)}",
        "",
        f"Time of the stages, which depends on what else the machine does: {stages}.",
        "",
        "## In short",
        "",
        *table(("", "error of the value", "truth inside the 90 % interval"), summary),
        *READING,
        "",
        "## Stiffness",
        "",
        *parameter_table(by_quantity["stiffness"], "kN/m", 1),
        "## Damping",
        "",
        *parameter_table(by_quantity["damping"], "kN s/m", 3),
        *(["## Friction", "", *parameter_table(friction, "kN", 3)] if friction else []),
        "## Plank drops alone",
        "",
        "Pooled value over the true one, by method; a dash where no record is usable.",
        "",
        *drop_table(result, truth),
        "## Axle loads",
        "",
        "Peak vertical tire force over static axle load.",
        "",
        *(prediction_table(passes) if passes else ["No pass was predicted.", ""]),
        "## Tires",
        "",
        "Tangent values at the first load case's static load. They take up what the model lacks and are not findings.",
        "",
        *parameter_table(tire_pairs(result, truth), "kN/m, kN s/m", 2),
        "## Agreement with the measured histories",
        "",
        "RMS of simulated minus measured over the range of the measured history; in-sample, sensor noise included.",
        "",
        *agreement_table(result, campaign["sensors"]["bump_run"]),
    ]
    return "\n".join(lines).rstrip() + "\n"


def main(output: Path, folder: Path) -> None:
    """Read the results and the truth, write the page."""
    result = json.loads((output / "result.json").read_text(encoding="utf-8"))
    campaign = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
    if result["campaign"] != truth["campaign"]["title"]:
        sys.exit(f"{output} holds results of '{result['campaign']}', not of '{truth['campaign']['title']}'.")
    heading, page = PAGES[folder.resolve().name]
    text = document(heading, result, campaign, truth)
    (ROOT / "docs" / page).write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    arguments = [Path(a) for a in sys.argv[1:]]
    main(arguments[0] if arguments else ROOT / "output", arguments[1] if len(arguments) > 1 else ROOT / "data")
