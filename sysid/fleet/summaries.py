"""What tables and pages of a fleet need of a campaign's ``result.json``: parsed once, however often they ask."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, get_args

from sysid.display import Z90
from sysid.files import json_table, read_bytes
from sysid.fleet.outcome import RESULT_FILE
from sysid.helper_process import helped_by, shared_with_helper
from sysid.results.contents import Trust

#: Results that are kept in memory, some kB each.
_MOST_KEPT = 50_000
#: Campaigns that one of two processes reads at a time, and how many are worth a second process.
_AT_ONCE, _WORTH_HELP = 25, 400
#: By the hash of the file: what was read once is not parsed again, and another content is another result.
_KEPT: dict[str, Summary] = {}


class Pass(NamedTuple):
    """What passes have to have in common; `bump` is what tells bumps apart."""

    load_case: str
    speed_km_h: float
    axle: int
    bump: str


class PeakRatio(NamedTuple):
    """Median and standard deviation of the logarithm of a ratio, and the name of the bump, None if it is not known."""

    kind: Pass
    shape: str | None
    middle: float
    sd: float


class Channel(NamedTuple):
    """A channel that is not good, by its log, column and kind of sensor, and the first sentence about it."""

    file: str | None
    channel: str | None
    kind: str | None
    verdict: str | None
    message: str | None


@dataclass(frozen=True)
class Summary:
    """`verdict` and first `reason`, empty where there is none; None for `ratios` that cannot be read."""

    verdict: str = ""
    reason: str = ""
    ratios: tuple[PeakRatio, ...] | None = None
    channels: tuple[Channel, ...] = ()


def summary_of(folder: Path) -> Summary:
    """The summary of the results in a folder; an empty one where there are none that can be read."""
    content = read_bytes(folder / RESULT_FILE) or b""
    digest = hashlib.sha256(content).hexdigest()
    if digest not in _KEPT:
        keep([(digest, _summary(json_table(content)))])
    return _KEPT[digest]


def keep(summaries: Iterable[tuple[str, Summary]]) -> None:
    """Remember summaries by the hash of their file."""
    if len(_KEPT) > _MOST_KEPT:
        _KEPT.clear()
    _KEPT.update(summaries)


def read_ahead(folders: Sequence[Path]) -> None:
    """Parse the results of many folders, with a second process where that is worth its start."""
    if len(folders) < _WORTH_HELP:
        return
    parts = [tuple(folders[n : n + _AT_ONCE]) for n in range(0, len(folders), _AT_ONCE)]
    with helped_by((__name__,)):
        for part in shared_with_helper(_summaries, parts):
            keep(part)


def _summaries(folders: Sequence[Path]) -> list[tuple[str, Summary]]:
    contents = (read_bytes(folder / RESULT_FILE) or b"" for folder in folders)
    return [(hashlib.sha256(content).hexdigest(), _summary(json_table(content))) for content in contents]


def _summary(document: Mapping[str, Any]) -> Summary:
    verdict, reason = _verdict(document.get("verdict"))
    try:
        ratios = tuple(_ratios(document["predictions"]))
    except (ValueError, KeyError, TypeError, OverflowError, AttributeError):
        ratios = None
    try:
        channels = tuple(channels_of(document))
    except (ValueError, KeyError, TypeError, AttributeError):
        channels = ()
    return Summary(verdict, reason, ratios, channels)


def _verdict(judged: Any) -> tuple[str, str]:
    if not isinstance(judged, dict) or judged.get("trust") not in get_args(Trust):
        return "", ""
    reasons = judged.get("reasons")
    return judged["trust"], str(reasons[0]) if isinstance(reasons, list) and reasons else ""


def _ratios(predictions: Iterable[Mapping[str, Any]]) -> Iterator[PeakRatio]:
    """Those of the predictions of a ``result.json`` that have quantiles."""
    for p in predictions:
        ratio, shape = p["peak_dynamic_load_ratio"], p.get("shape")
        values = [v for q in ("q05", "q50", "q95") if isinstance(v := ratio.get(q), float) and v > 0.0]
        # In results of an earlier version the file's name has that of a shape in it, but none of a scanned bump.
        bump, name = (str(p["file"]), None) if shape is None else (str(shape["sha256"]), str(shape["name"]))
        kind = Pass(str(p["load_case"]), float(p["speed_km_h"]), int(p["axle"]), bump)
        if len(values) == 3:
            low, middle, high = (math.log(v) for v in values)
            yield PeakRatio(kind, name, middle, (high - low) / (2.0 * Z90))


def channels_of(document: Mapping[str, Any]) -> Iterator[Channel]:
    """The channels that are not good in the content of a ``result.json``.

    Raises ValueError if a word about one is no text.
    """
    for c in document.get("quality", []):
        words = [*(c.get(key) for key in ("file", "channel", "kind", "verdict")), next(iter(c["messages"]), None)]
        if not all(word is None or isinstance(word, str) for word in words):
            raise ValueError("a word that is none")
        yield Channel(*words)
