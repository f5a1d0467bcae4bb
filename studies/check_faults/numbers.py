"""Every declared number of a campaign times a factor: does `check` name its key, and no other?

    python -m studies.check_faults.numbers [--part development | kept] [--healthy N] [--document FILE]

Logs and scans are read once: only the campaign file changes. Thresholds were set on the part ``development`` alone; the
part ``kept`` has other trucks and other factors.
"""

from __future__ import annotations

import argparse
import copy
import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast
from unittest.mock import patch

import numpy as np

from studies.check_faults.campaigns import base
from studies.check_faults.case import HARMLESS as HARMLESS_WORDS
from studies.check_faults.healthy_numbers import varied
from studies.documents import write_between_marks
from sysid.campaign.records import Scan
from sysid.campaign.toml.reading import parse_toml
from sysid.errors import SysidError
from sysid.logs import registry
from sysid.road import point_cloud, scan
from sysid.workflow.inputs import Inputs
from sysid.workflow.stage import Context
from sysid.workflow.stages.data import CHECK

#: Where a number stands in the parsed file.
Place = tuple[str | int, ...]

#: Trucks and factors by part of the study; those kept were not looked at before the rules were finished.
PARTS = MappingProxyType(
    {
        "development": (("data", "rigid3"), (1e3, 1e-3, 2.2, 25.4, 3.6, 2.0, -1.0)),
        "kept": (
            ("rigid2", "linear_truck", "semitrailer5", "rigid4"),
            (1e3, 1e-3, 2.2, 25.4, 3.6, 2.0, -1.0, 0.5, 1 / 2.2, 1 / 3.6, 9.81, 1 / 25.4),
        ),
    }
)
#: Changes that move no k and no peak by 5 %, and why; those with figures were fitted by `fit --quick` and `predict` on
#: the three-axle truck (largest changes of k, peak load ratio).
HARMLESS: MappingProxyType[str, tuple[Callable[[float], bool], str]] = MappingProxyType(
    {
        "wheelbase_m": (lambda f: True, "is displayed only"),
        "cargo_mass_kg": (lambda f: True, "is displayed only"),
        "repeat": (lambda f: True, "is displayed only"),
        "tire_stiffness_N_per_m": (lambda f: 1e-3 <= f <= 25.4, "1.5 %, 1.5 % from times 1/1000 to times 25.4"),
        "tire_damping_N_s_per_m": (lambda f: 0 < f <= 25.4, "0.02 %, 0.03 % from times 1/1000 to times 25.4"),
        "cg_height_m": (lambda f: 0 < f <= 2.2, "1.6 %, 3.1 % from times 1/1000 to times 2"),
        "plank_height_m": (lambda f: 0.45 < f <= 2.2, "0.01 %, 0.01 % for times 2 in all drops"),
        "order": (lambda f: f > 0, "without the filter k moves by 0.04 %"),
        "cutoff_hz": (lambda f: f >= 0.45, "0.4 %, 0.9 % for times 1/2.2; without the filter k moves by 0.04 %"),
        "range": (
            lambda f: f >= 0.4,
            "`check` reports readings that reach it; where none does, the readings stay the same (from times 0.4 on)",
        ),
        "sample_interval_s": (lambda f: 0.05 < f < 20, "the stamps of the logs are used"),
    }
)


@dataclass(frozen=True)
class Number:
    """One declared number, or one key in all entries of its tables: `places`, and what tells it from others."""

    key: str
    places: tuple[Place, ...]

    @property
    def label(self) -> str:
        """Where it stands."""
        return ".".join(map(str, self.places[0])) if len(self.places) == 1 else f"{self.key} everywhere"


def numbers(parsed: dict[str, Any]) -> list[Number]:
    """Every number of a campaign file but zeros, and every key that stands in several places as a whole."""
    single = [Number(_key(place), (place,)) for place, value in _walk(parsed, ()) if value != 0]
    by_key: dict[tuple[str, str], list[Place]] = {}
    for number in single:
        (place,) = number.places
        by_key.setdefault((str(place[0]), number.key), []).append(place)
    return [*single, *(Number(key, tuple(p)) for (_, key), p in by_key.items() if len(p) > 1)]


def _walk(value: Any, place: Place) -> Iterator[tuple[Place, float]]:
    if isinstance(value, dict):
        for key, entry in value.items():
            if (*place, key) != ("schema",):
                yield from _walk(entry, (*place, key))
    elif isinstance(value, list):
        for index, entry in enumerate(value):
            yield from _walk(entry, (*place, index))
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield place, value


def _key(place: Place) -> str:
    return next(part for part in reversed(place) if isinstance(part, str))


def changed(parsed: dict[str, Any], number: Number, factor: float) -> dict[str, Any]:
    """The file with a number times a factor; whole numbers stay whole if they can."""
    result = copy.deepcopy(parsed)
    for place in number.places:
        at: Any = result
        for part in place[:-1]:
            at = at[part]
        value = at[place[-1]] * factor
        at[place[-1]] = int(value) if isinstance(at[place[-1]], int) and float(value).is_integer() else float(value)
    return result


def thinned(found: Sequence[Number]) -> list[Number]:
    """Without most of the entries of long lists of tests and sensors, which are alike: every fifth stays."""
    seen: Counter[tuple[str, ...]] = Counter()
    kept = []
    for number in found:
        place = number.places[0]
        alike = (str(place[0]), str(place[1]), number.key)
        of_list = len(number.places) == 1 and place[0] in ("tests", "sensors") and place[1] != "prediction"
        seen[alike] += of_list
        if not of_list or seen[alike] % 5 == 2:
            kept.append(number)
    return kept


class Bench:
    """A campaign whose logs and scans are read once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.parsed = parse_toml((folder / "campaign.toml").read_bytes(), "campaign.toml")
        self._known: dict[Any, Any] = {}

    def check(self, parsed: dict[str, Any]) -> tuple[str, frozenset[str]]:
        """How `check` ends with this campaign file (``refused``, ``rejected``, ``passed``), and its sentences."""
        with ExitStack() as stack:
            for target, replacement in (
                ("sysid.campaign.toml.reading.parse_toml", lambda *_: parsed),
                ("sysid.campaign.inputs.logs.read_channels", self._channels),
                ("sysid.workflow.inputs.read_point_cloud", self._points),
                ("sysid.bookkeeping.check.analyse_scan", self._scan),
            ):
                stack.enter_context(patch(target, replacement))
            try:
                report = CHECK.compute(cast(Context, _Inputs(Inputs(self.folder))))
            except SysidError as error:
                return "refused", frozenset([str(error)])
        said = [*report.messages, *report.left_out]
        said += [f"{f.file}, {f.column}: {m}" for f in report.channels for m in f.messages]
        rejected = any(f.verdict == "rejected" for f in report.channels) or bool(report.left_out)
        return "rejected" if rejected else "passed", frozenset(said)

    def _once(self, key: Any, make: Callable[[], Any]) -> Any:
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def _channels(self, file: Any, label: str, request: Any) -> Any:
        return self._once((label, request), lambda: registry.read_channels(file, label, request))

    def _points(self, file: Any, unit: str = "m") -> Any:
        return self._once((str(file), unit), lambda: point_cloud.read_point_cloud(file, unit))

    def _scan(self, cloud: Scan) -> Any:
        return self._once((id(cloud.points_m), cloud.heading_rad), lambda: scan.analyse_scan(cloud))


@dataclass(frozen=True)
class _Inputs:
    """As much of a stage's context as `check` needs."""

    inputs: Inputs


def judged(number: Number, said: frozenset[str]) -> str:
    """``named`` if a new sentence has the key, ``other`` if there are new sentences without it, else ``silent``."""
    if any(_has(sentence, number.key) for sentence in said):
        return "named"
    return "other" if said else "silent"


def _has(sentence: str, key: str) -> bool:
    before, _, after = sentence.partition(key)
    return (
        bool(after or sentence.endswith(key))
        and not before[-1:].isalnum()
        and not (after[:1].isalnum() or after[:1] == "_")
    )


def harmless(number: Number, factor: float) -> bool:
    """Whether the change moves no k and no peak."""
    test, _ = HARMLESS.get(number.key, (lambda _: False, ""))
    return test(factor)


def sweep(bench: Bench, factors: Sequence[float], share: float, seed: int) -> Iterator[dict[str, Any]]:
    """One record per number and factor, of a share of them that is drawn at random."""
    _, before = bench.check(bench.parsed)
    rng = np.random.default_rng(seed)
    for number in thinned(numbers(bench.parsed)):
        for factor in factors:
            if rng.random() > share:
                continue
            end, said = bench.check(changed(bench.parsed, number, factor))
            new = said - before
            yield {
                "label": number.label,
                "key": number.key,
                "factor": factor,
                "end": end,
                "verdict": judged(number, new),
                "harmless": harmless(number, factor),
                "said": sorted(new)[:6],
            }


def healthy(bench: Bench, count: int, seed: int) -> Iterator[dict[str, Any]]:
    """Sentences about variations of a campaign that are right."""
    _, before = bench.check(bench.parsed)
    for number in range(count):
        parsed = varied(bench.parsed, np.random.default_rng([seed, number]))
        _, said = bench.check(parsed)
        yield {"number": number, "said": sorted(x for x in said - before if not re.search(HARMLESS_WORDS, x))}


def table(records: Sequence[dict[str, Any]]) -> str:
    """Markdown: verdicts by truck."""
    lines = [
        "| truck | numbers times factors | move k or a peak | named | other key | silent |",
        "|---|---|---|---|---|---|",
    ]
    for truck in (*dict.fromkeys(r["truck"] for r in records), "all"):
        of_truck = [r for r in records if truck in ("all", r["truck"])]
        harm = [r for r in of_truck if not r["harmless"]]
        counts = Counter(r["verdict"] for r in harm)
        cells = [f"{counts[v]} ({100 * counts[v] / max(1, len(harm)):.1f} %)" for v in ("named", "other", "silent")]
        lines.append(f"| {truck} | {len(of_truck)} | {len(harm)} | {' | '.join(cells)} |")
    wrong = [r for r in records if r["harmless"] and r["verdict"] == "other"]
    lines += ["", f"Of the changes that move nothing, {len(wrong)} are answered with another key.", ""]
    lines += ["| not named | truck | times | ends in |", "|---|---|---|---|"]
    missed: dict[tuple[str, str, str], list[str]] = {}
    for r in records:
        if not r["harmless"] and r["verdict"] != "named":
            missed.setdefault((r["label"], r["truck"], r["verdict"]), []).append(f"{r['factor']:.3g}")
    lines += [f"| {label} | {truck} | {', '.join(f)} | {verdict} |" for (label, truck, verdict), f in missed.items()]
    lines += ["", "Taken as harmless:", ""]
    lines += [f"- {key}: {reason};" for key, (_, reason) in HARMLESS.items()]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Sweep a part, and its healthy variations; what is done is kept in a file per truck."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/check_faults"))
    parser.add_argument("--part", choices=list(PARTS), default="kept")
    parser.add_argument("--trucks", nargs="+", default=None, help="some trucks of the part")
    parser.add_argument("--seed", type=int, default=7301)
    parser.add_argument("--healthy", type=int, default=10, help="healthy variations per truck")
    parser.add_argument("--share", type=float, default=1.0, help="share of the cases that is drawn")
    parser.add_argument("--document", type=Path, default=None)
    options = parser.parse_args(arguments)
    trucks, factors = PARTS[options.part]
    trucks = tuple(options.trucks or trucks)
    records, right = [], []
    for truck in trucks:
        bench = Bench(base(truck, options.output / "bases", options.seed))
        kept = options.output / f"numbers_{options.part}_{truck}.json"
        if not kept.exists():
            done = {
                "healthy": list(healthy(bench, options.healthy, options.seed)),
                "records": list(sweep(bench, factors, options.share, options.seed)),
            }
            kept.write_text(json.dumps(done), encoding="utf-8")
        read = json.loads(kept.read_text(encoding="utf-8"))
        records += [{**r, "truck": truck} for r in read["records"]]
        right += [{**r, "truck": truck} for r in read["healthy"]]
    accused = [r for r in right if r["said"]]
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False).stdout
    body = f"Commit {commit.strip()}. {len(right)} healthy variations, {len(accused)} accused.\n\n{table(records)}"
    sys.stdout.write(f"{body}\n" + "\n".join(f"{r['truck']}: {s}" for r in accused for s in r["said"]) + "\n")
    if options.document is not None:
        write_between_marks(options.document, "declared numbers", body)


if __name__ == "__main__":
    main()
