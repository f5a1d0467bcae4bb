"""The part of the page that compares kernels and solvers, from the JSON file alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.documents import write_between_marks

#: Beginning of a ratio's name, and what its median processor time should be.
GOALS = {
    "likelihood / kernel": ("<=", 4.0),
    "one simulation / kernel per set": ("<=", 15.0),
    "Jacobian / likelihood": ("<=", 24.0),
    "diffrax": (">=", 15.0),
    "CVODE": (">=", 80.0),
}
#: Load of the machine before the benchmark begins from which on somebody else is at work.
BUSY = 0.5


def write_document(found: dict[str, Any], path: Path) -> None:
    """Write the part between the marks ``kernels`` of a page, or the file by itself where there are none."""
    parts = [_introduction(found), _ratios(found), _seconds(found), _accuracy(found), _growth(found), _processes(found)]
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = path.with_suffix(".svg" if path.with_suffix(".svg").exists() else ".png").name
    parts.insert(2, f"![Cost and growth]({picture})")
    text = "\n\n".join(part for part in parts if part)
    if path.exists() and "<!-- kernels: begin -->" in path.read_text(encoding="utf-8"):
        write_between_marks(path, "kernels", text)
    else:
        path.write_text(text + "\n", encoding="utf-8")


def _introduction(found: dict[str, Any]) -> str:
    machine, work = found["machine"], found["work"]
    versions = ", ".join(f"{n} {v}" for n, v in machine["versions"].items() if v)
    missing = found["missing_peers"]
    return f"""\
## Beside other solvers

Written by `python -m benchmarks`. Medians of {found["rounds"]} interleaved rounds
(JAX and the peers in every third or sixth), quartiles in brackets.

Machine: {machine["cores"]} cores, {machine["instruction_set"]}, load {machine["load_before"]:.1f} before and \
{machine["load_after"]:.1f} after; Python {machine["python"]}, {versions}.\
{" Not installed: " + ", ".join(missing) + "." if missing else ""}\
{_remark_on_load(machine["load_before"])}

Work: {len(work["runs"])} runs of the linear truck, {work["simulated_s"]:.1f} s in all,
{work["channels"]} channels, {work["parameters"]} parameters, the default contact law (footprint map, forward force,
exponent, real heights), linear suspensions, steps of {work["step_s"] * 1e3:g} ms. A *set* is one parameter set through
all these runs, that is one likelihood.

*kernel* is the native engine's own sources compiled into a program without Python, on as many threads: its
ratio shows what our path adds, not how good the kernel is. Peers simulate the same runs,
filter the signals afterwards, for which they give them at a quarter of the steps of ours, and square the residuals;
offsets and gains are not asked of them. *Unfiltered* leaves the filter out and asks for signals at the samples alone:
less work than the likelihood, a lower bound of what a peer could take. CVODE and LSODA take
one set at a time on one core, with a right-hand side in numba, and are measured on one set. Processor time adds up all
threads and so compares equal numbers of cores; wall time compares what somebody waits for."""


def _remark_on_load(before: float) -> str:
    if before < BUSY:
        return ""
    return (
        " Other work ran on the machine: wall times are longer than on a quiet one, processor times a little. Ratios "
        "pair\nmeasurements of the same round, so both sides had to bear it."
    )


def _text(values: list[float], scale: float = 1.0, digits: int = 3) -> str:
    low, middle, high, _ = (v * scale for v in values)
    return f"{middle:.{digits}g} ({low:.{digits}g}–{high:.{digits}g})"


def _ratios(found: dict[str, Any]) -> str:
    lines = ["## Ratios", "", "| ratio | processor time | wall time | goal |", "|---|---|---|---|"]
    for name, ratio in found["ratios"].items():
        processor, wall = ratio["processor_s"], ratio["wall_s"]
        lines.append(f"| {name} | {_text(processor)} | {_text(wall)} | {goal_of(name, processor[1])} |")
    return "\n".join([*lines, "", "A goal is met or missed by the median processor time."])


def goal_of(name: str, found: float) -> str:
    """The goal of a ratio and whether the ratio found keeps it; empty where it has none."""
    for start, (side, limit) in GOALS.items():
        if name.startswith(start):
            met = found <= limit if side == "<=" else found >= limit
            return f"{side} {limit:g}: " + ("met" if met else "**missed**")
    return ""


def _seconds(found: dict[str, Any]) -> str:
    lines = ["## Times", "", "Likelihoods per set, posterior steps per step of all walkers, others per call.", ""]
    lines += ["| work | processor [ms] | wall [ms] |", "|---|---|---|"]
    for name, s in found["seconds"].items():
        lines.append(f"| {name} | {_text(s['processor_s'], 1e3)} | {_text(s['wall_s'], 1e3)} |")
    step = found["seconds"]["native posterior step"]["wall_s"][1]
    return "\n".join([*lines, "", f"Posterior: {1.0 / step:.2g} steps of one ensemble per second."])


def _accuracy(found: dict[str, Any]) -> str:
    accuracy = found["accuracy"]
    lines = [
        "## Accuracy",
        "",
        f"Relative RMS error of the worst channel of any run; reference: {accuracy['reference']}.",
        "Peers run at the loosest tolerance that reaches 1e-4.",
        "",
        "| solver | relative tolerance | worst channel |",
        "|---|---|---|",
    ]
    for name, one in accuracy["worst_channel"].items():
        tolerance = "fixed steps" if one["tolerance"] is None else f"{one['tolerance']:.0e}"
        lines.append(f"| {name} | {tolerance} | {one['worst_channel']:.1e} |")
    return "\n".join(
        [*lines, "", f"Misfits of kernel and product differ by {accuracy['kernel_misfit_difference']:.0e} (relative)."]
    )


def _growth(found: dict[str, Any]) -> str:
    lines = [
        "## Growth",
        "",
        "Exponent of cost against size, native engine; 1 is in proportion. Samples: one passage sampled more densely.",
        "Axles: the truck's axles repeated. Parameters: residuals with their derivatives by so many.",
        "",
        "| size | from | to | exponent |",
        "|---|---|---|---|",
    ]
    for what, one in found["growth"].items():
        lines.append(f"| {what} | {one['size'][0]} | {one['size'][-1]} | {_text(one['exponent'])} |")
    return "\n".join(lines)


def _processes(found: dict[str, Any]) -> str:
    lines = ["## Processes", "", "| what | wall |", "|---|---|"]
    for name, values in found["imports"].items():
        unit = "" if "/" in name else " s"
        lines.append(f"| {name} | {_text(values['wall_s'])}{unit} |")
    for name, one in found.get("start_up", {}).items():
        lines.append(f"| first batch of 64 sets, {name}, empty caches | {one['cold_s']:.1f} s |")
        lines.append(f"| first batch of 64 sets, {name}, full caches | {_text(one['warm_s'])} s |")
    for name, one in found.get("memory", {}).items():
        more = (one["peak_bytes"] - one["peak_before_bytes"]) / 1e9
        lines.append(
            f"| peak memory, batch of 256 sets, whole campaign, {name} | {one['peak_bytes'] / 1e9:.2f} GB, "
            f"{more:.2f} GB more than before the batch |"
        )
    for name, one in found.get("fit", {}).items():
        stages = ", ".join(
            f"{stage} {seconds:.1f} s" for stage, seconds in one["stages_s"].items() if ": " not in stage
        )
        lines.append(f"| `calibrate.py fit`, {name} cache | {one['process_s']:.1f} s ({stages}) |")
    return "\n".join(lines)
