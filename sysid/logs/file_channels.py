"""What a file has, before values are read: its channels, the names by which each can be asked for, and their axes."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from sysid.logs.channels import LARGEST
from sysid.logs.names import decoded, normal_name
from sysid.logs.time_columns import find_time, time_unit
from sysid.wording import shorten

#: Cells for units that say nothing.
_NO_UNIT = ("-", "--", "None", "NONE", "none")
#: Names of axes in the languages of loggers: time, any quantity, and quantities that are not time.
_TIME_AXIS = re.compile(r"time|zeit|temps|tiempo|tempo|^t$|seconds?$|sekunden?$", re.IGNORECASE)
_ANY_AXIS = ("x", "x axis", "x-axis", "x-achse", "axe x", "x_value", "abscissa", "none", "unknown", "general")
_OTHER_AXIS = re.compile(
    r"angle|winkel|distance|strecke|\bweg\b|length|position|displacement|frequen|\border\b|ordnung|\brpm\b|speed|index|"
    r"number|sample|cycle|temperature|pressure|strain|force",
    re.IGNORECASE,
)
#: Names that a sentence lists.
LISTED = 4


class RefusedError(ValueError):
    """The rest of a sentence about the file, behind its name."""


@dataclass(frozen=True)
class FileChannel:
    """One channel of a file before its values are read.

    - `length` is its number of values.
    - `load` gives values (n,), a masked array where the format marks some as invalid, and unit.
    - `group` is what people call the part of the file in which it stands, `place` what tells two parts of the same name
      apart, such as a number.
    - `time` gives its stamps in seconds where the format ties them to the channel, or is the channel that holds them;
      `clock` is what people call them.  Without it a channel of the same part is looked for that has the name of a
      time.  Channels with the same function have the same stamps; of others the stamps are compared.
    - `axis`: whether it is the axis of others and no signal.
    - `first_row` is what people call the first value.
    - `in_order`: whether channels have the order in which somebody wrote them, so that a column of time stands to the
      left of its channels.
    - `invalid` says what the masked values are.
    - `path` is the name by which the channel, and no other, can be asked for.
    """

    name: str
    length: int
    load: Callable[[], tuple[np.ndarray, str | None]]
    group: str = ""
    time: Callable[[], np.ndarray] | FileChannel | None = None
    clock: str = ""
    first_row: int = 1
    place: Hashable = None
    in_order: bool = True
    axis: bool = False
    invalid: str = "marked as invalid"
    path: str = ""

    def __post_init__(self) -> None:
        for key in ("name", "group"):
            object.__setattr__(self, key, normal_name(getattr(self, key)))
        if not self.path:
            object.__setattr__(self, "path", self.plain_path)

    @property
    def plain_path(self) -> str:
        """Name with the group before it."""
        return f"{self.group}/{self.name}" if self.group else self.name


def unreadable(name: str, sentence: str, group: str = "", place: Hashable = None) -> FileChannel:
    """A channel of the file that cannot be read, with the rest of the sentence that says so to whoever asks for it."""
    return FileChannel(name, 2, partial(_refuse, RefusedError(sentence)), group, place=place)


def _refuse(error: RefusedError) -> Any:
    raise error


@lru_cache(maxsize=4096)
def even_time(start_s: float, step_s: float, count: int) -> Callable[[], np.ndarray]:
    """Stamps start + k step [s] of an evenly sampled channel: a function that refuses a step that is not positive."""
    if not (0.0 < step_s < LARGEST and abs(start_s) < LARGEST):
        return no_time(
            RefusedError(f"has a channel with a sample interval of {step_s:g} s from {start_s:g} s on; export it again")
        )
    return lambda: start_s + step_s * np.arange(count)


def even_axis(
    what: str, unit: str | None, start: float, step: float, count: int, path: str, zero_s: float = 0.0
) -> Any:
    """Stamps of an evenly sampled channel whose axis is `what` in `unit`; of axes that are not time the refusal.

    `zero_s` is the time at which the axis is zero.
    """
    try:
        factor = axis_seconds(what, unit, path)
    except RefusedError as error:
        return no_time(error)
    return even_time(zero_s + factor * start, factor * step, count)


def no_time(error: RefusedError) -> Callable[[], np.ndarray]:
    """In place of stamps, the refusal of a channel whose axis is none of time."""
    return partial(_refuse, error)


def axis_seconds(what: str, unit: str | None, path: str) -> float:
    """Seconds in one count of the axis of a channel, by what the file says about it.

    Parameters
    ----------
    what : quantity of the axis, such as ``Time`` or ``angle``; empty where the file does not say.
    unit : its unit, empty or None where the file does not say.
    path : name of the channel.

    Raises
    ------
    RefusedError
        If it is not time, by its quantity or its unit.
    """
    what, unit = what.strip(), (unit_text(unit) or "").rstrip(".")
    factor = time_unit(unit) if unit else 1.0
    says_time = _TIME_AXIS.search(what) is not None
    says_nothing = not what or what.casefold() in _ANY_AXIS
    if factor is None or not (says_time or says_nothing or (unit and not _OTHER_AXIS.search(what))):
        raise not_time(what or "a quantity", unit, path)
    return factor


def not_time(what: str, unit: str, path: str) -> RefusedError:
    """The refusal of a channel whose axis is not time."""
    shown = f"{shorten(what, 40)} [{shorten(unit, 20)}]" if unit else shorten(what, 40)
    return RefusedError(
        f"has no time for '{shorten(path)}': its axis is {shown}, not time; export it over time in seconds"
    )


def is_time(column: FileChannel, wanted: str | None) -> bool:
    """Whether a channel holds stamps by its name: the wanted one, also with its group, else a usual one."""
    return find_time((column.name,), wanted) is not None or column.path == wanted


def told_apart(channels: Sequence[FileChannel]) -> list[FileChannel]:
    """The channels with paths that name one each: numbers tell parts of one name apart, and names within a part."""
    places: dict[str, dict[Hashable, None]] = defaultdict(dict)
    for channel in channels:
        places[channel.group][channel.place] = None
    several = {
        (group, place): f"{group} #{number}"
        for group, found in places.items()
        if len(found) > 1
        for number, place in enumerate(found, start=1)
    }
    paths = [replace(c, group=several.get((c.group, c.place), c.group)).plain_path for c in channels]
    counts, seen = Counter(paths), Counter[str]()
    for number, path in enumerate(paths):
        seen[path] += 1
        if counts[path] > 1:
            paths[number] = f"{path} #{seen[path]}"
    return [c if c.path == path else replace(c, path=path) for c, path in zip(channels, paths, strict=True)]


def by_name(channels: Sequence[FileChannel], name: str) -> FileChannel | None:
    """The channel with this path, else with this group and name, else with this name; None where there is none.

    Raises
    ------
    RefusedError
        If there are several.
    """
    hits = (
        [c for c in channels if c.path == name]
        or [c for c in channels if c.plain_path == name]
        or [c for c in channels if c.name == name]
    )
    hits = [c for c in hits if c.length] or hits
    if len(hits) > 1:
        paths = [f"'{shorten(c.path)}'" for c in hits]
        more = f" and {len(paths) - LISTED} more" if len(paths) > LISTED else ""
        raise RefusedError(
            f"has {len(hits)} channels with the name '{shorten(name)}'; name the column {' or '.join(paths[:LISTED])}"
            f"{more}"
        )
    return hits[0] if hits else None


def numbers_of(array: np.ndarray, path: str) -> np.ndarray:
    """Values as float64; those that are marked as invalid, infinite or as good as that as NaN.

    Raises
    ------
    RefusedError
        If they are no real numbers.
    """
    flat = np.asarray(array)
    if flat.ndim != 1:
        flat = flat.reshape(-1)
    if flat.dtype.kind not in "biuf":
        what = "complex numbers" if flat.dtype.kind == "c" else "text or dates"
        raise RefusedError(f"has {what} in '{shorten(path)}', expected numbers; export it as numbers")
    with np.errstate(over="ignore", invalid="ignore"):
        numbers = np.array(flat, dtype=np.float64)
    finite = np.abs(numbers) < LARGEST
    if isinstance(array, np.ma.MaskedArray):
        finite &= ~np.ma.getmaskarray(array).reshape(-1)
    if not finite.all():
        numbers[~finite] = np.nan
    return numbers


def unit_text(unit: Any) -> str | None:
    """A unit as its file writes it, without brackets; None where it says nothing."""
    if isinstance(unit, bytes):
        unit = decoded(unit)
    plain = unit.strip().strip("[]() ") if isinstance(unit, str) else ""
    return shorten(plain, 40) if plain and plain not in _NO_UNIT else None
