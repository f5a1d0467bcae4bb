"""One figure of the benchmark: times per set, growth, and ratios."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

_COLOURS = {"kernel": "#555555", "native": "#0b6fa4", "jax": "#d9822b", "peer": "#8a4fa3"}


def draw(found: dict[str, Any], paths: list[Path]) -> None:
    """Write the figure to every path, in the format of its suffix."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12.5, 6.0), width_ratios=[1.25, 1.0], layout="constrained")
    _times(left, found["seconds"])
    _growth(right, found["growth"])
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=130)
    plt.close(figure)


def _kind(name: str) -> str:
    return next((kind for kind in ("kernel", "native", "jax") if name.startswith(kind)), "peer")


def _times(ax: Any, seconds: dict[str, Any]) -> None:
    names = sorted(seconds, key=lambda n: seconds[n]["processor_s"][1], reverse=True)
    for row, name in enumerate(names):
        low, middle, high, _ = seconds[name]["processor_s"]
        colour = _COLOURS[_kind(name)]
        ax.barh(row, middle * 1e3, color=colour, height=0.7)
        ax.plot([low * 1e3, high * 1e3], [row, row], color="black", linewidth=1.2)
        ax.text(max(middle, high) * 1.12e3, row, f"{middle * 1e3:.3g}", va="center", fontsize=8)
    ax.set_xscale("log")
    ax.set_yticks(range(len(names)), names, fontsize=8)
    ax.set_xlim(right=ax.get_xlim()[1] * 2.5)
    ax.set_xlabel("processor time per set, per call or per step [ms]; line: quartiles")
    ax.set_title("Cost", loc="left")
    ax.spines[["top", "right"]].set_visible(False)


def _growth(ax: Any, growth: dict[str, Any]) -> None:
    for marker, (what, one) in zip("osD^v", growth.items(), strict=True):
        size = [s / one["size"][0] for s in one["size"]]
        cost = [s[1] / one["processor_s"][0][1] for s in one["processor_s"]]
        label = f"{what}, from {one['size'][0]}: exponent {one['exponent'][1]:.2f}"
        ax.plot(size, cost, marker=marker, label=label)
    most = max(s[-1] / s[0] for s in (one["size"] for one in growth.values()))
    ax.plot([1, most], [1, most], color="black", linewidth=0.8, linestyle=":", label="in proportion")
    ax.set_xscale("log", base=2)
    ax.set_yscale("log", base=2)
    ax.set_xlabel("size, relative to the smallest")
    ax.set_ylabel("processor time, relative to the smallest")
    ax.set_title("Growth", loc="left")
    ax.legend(frameon=False, fontsize=9)
    ax.spines[["top", "right"]].set_visible(False)
