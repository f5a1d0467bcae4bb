"""One case: a campaign, one fault in it, and what `calibrate.py check` says that it did not say before."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from studies.check_faults import clocks, figures, files, lists, lost, sensors, wiring
from studies.check_faults.campaigns import BASES, base, healthy
from studies.check_faults.made import EVERYWHERE, Copy, Fault, Made
from studies.faults.campaign_copy import DoesNotApply

FAMILIES: dict[str, dict[str, Fault]] = {
    "sensors": sensors.FAULTS,
    "clocks": clocks.FAULTS,
    **lists.FAULTS,
    "files": files.FAULTS,
    "wiring": wiring.FAULTS,
    "figures": figures.FAULTS,
    "lost": lost.FAULTS,
}
FAULTS = [(family, name) for family, faults in FAMILIES.items() for name in faults]
#: Faults in campaigns whose files keep their names, which say axle, load case and speed.
TELLING = "named files"
#: Bumps of these bases are the same from both sides.
SYMMETRIC = ("rigid3",)


@dataclass(frozen=True)
class Said:
    """What the command said: exit code, sentences, and records (log, column) with findings."""

    code: int
    sentences: frozenset[str]
    accused: frozenset[tuple[str, str]]
    rejected: frozenset[tuple[str, str]]
    records: int
    lines: tuple[str, ...] = field(default=(), repr=False)


def cases() -> range:
    """Numbers of the cases with a fault: every fault on every base."""
    return range(len(FAULTS) * len(BASES))


def without_telling_names(source: Path, made: Path) -> Path:
    """A copy of a campaign whose logs have numbers for names, so that only their contents can tell what they are."""
    shutil.rmtree(made, ignore_errors=True)
    shutil.copytree(source, made)
    file = made / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    for kind in ("bump_runs", "plank_drops"):
        for number, name in enumerate(dict.fromkeys(re.findall(rf'"({kind}/[^"]+)"', text))):
            plain = f"{kind}/{kind[0]}{number:03d}.csv"
            (made / name).rename(made / plain)
            text = text.replace(f'"{name}"', f'"{plain}"')
    file.write_text(text, encoding="utf-8")
    return made


def check(folder: Path) -> Said:
    """`calibrate.py check` on a campaign, in this process."""
    from sysid.cli.main import cli

    out, err = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as output, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli(["check", str(folder), "--output", output], standalone_mode=False)
            code = 0
        except SystemExit as ending:
            code = int(ending.code or 0)
        text = f"{out.getvalue()}\n{err.getvalue()}".replace(output, "").replace(str(folder), "")
    return _read(code, text.splitlines())


def _read(code: int, lines: list[str]) -> Said:
    sentences = {
        x.strip() for x in lines if x.rstrip().endswith((".", "?")) and " " * 3 not in x.strip() and len(x) > 40
    }
    sentences = {x for x in sentences if not re.match(r"\d+ channel records|Every channel with", x)}
    findings = [re.match(r"(\S+\.csv), (\S+): ", x) for x in sentences]
    rows = [re.split(r"\s{2,}", x.strip()) for x in lines if x.rstrip().endswith("rejected")]
    rejected = {(r[0], r[1]) for r in rows if len(r) > 3}
    counts = [int(m.group(1)) for x in lines if (m := re.match(r"(\d+) channel records", x))]
    accused = frozenset((m.group(1), m.group(2)) for m in findings if m) | rejected
    return Said(code, frozenset(sentences), accused, frozenset(rejected), sum(counts), tuple(lines))


def faulty(number: int, folder: Path, seed: int, known: dict[str, Said]) -> dict[str, Any]:
    """The case of a number; `known` keeps what the bases say without a fault."""
    # Every fault once before any comes twice, on other campaigns in turn: a study that was stopped is an even one.
    turn, which = divmod(number, len(FAULTS))
    name = BASES[(turn + which) % len(BASES)]
    family, fault = FAULTS[which]
    telling = fault.endswith(TELLING)
    source = (
        base(name, folder, seed)
        if telling
        else without_telling_names(base(name, folder, seed), folder / "plain" / name)
    )
    if str(source) not in known:
        known[str(source)] = check(source)
    with tempfile.TemporaryDirectory() as place:
        copy = Copy(Path(place) / "campaign", np.random.default_rng([seed, number]), name in SYMMETRIC)
        shutil.copytree(source, copy.folder)
        record = {"number": number, "family": family, "fault": fault, "base": name}
        try:
            made = FAMILIES[family][fault](copy)
        except DoesNotApply as reason:
            return {**record, "ending": "does not apply", "said": str(reason)}
        return {**record, **judged(made, check(copy.folder), known[str(source)])}


def judged(made: Made, after: Said, before: Said) -> dict[str, Any]:
    """How a case ends, and which healthy channels are accused."""
    new = sorted(after.sentences - before.sentences)
    stopped = after.code not in (0, before.code)
    right = [x for x in new if any(re.search(word, x) for word in made.words)]
    healthy_accused = sorted(
        (f, c)
        for f, c in after.accused - before.accused
        if EVERYWHERE not in made.columns and not set(c.split("+")) & made.columns
    )
    ending = ("stopped" if stopped else "warned") if right else ("other" if new or stopped else "silent")
    return {
        "said": made.said,
        "ending": ending,
        "code": after.code,
        "harmless": made.harmless,
        "right": right[:2],
        "new": new[:8],
        "falsely": [f"{f}, {c}" for f, c in healthy_accused],
        "falsely_rejected": len([1 for pair in healthy_accused if pair in after.rejected]),
        "records": before.records,
    }


def unharmed(number: int, folder: Path, seed: int, trucks: Sequence[str] = ()) -> dict[str, Any]:
    """What is said of a healthy campaign: everything that names a fault counts."""
    said = check(healthy(number, folder, seed, trucks))
    accusing = sorted(x for x in said.sentences if not re.search(HARMLESS, x))
    return {
        "number": number,
        "code": said.code,
        "rejected": sorted(f"{f}, {c}" for f, c in said.rejected),
        "accusing": accusing,
        "records": said.records,
    }


#: Sentences that describe a healthy campaign: readings at the declared range, a rate, the level of the noise, how far
#: a prediction goes beyond the runs.
HARMLESS = (
    r"reach(es)? the range of|the noise is \d+ % of|stamps are used|heading was turned|"
    r"the prediction is an extrapolation"
)
