"""Time of the waveforms of a TDMS file: step, start and unit of their axis, also where a recording was begun again."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np

from sysid.logs.file_channels import RefusedError, axis_seconds, even_time, no_time
from sysid.wording import shorten

_NANOSECOND = np.timedelta64(1, "ns")


class Waveforms:
    """Starts of all channels of a file, as its segments say them: npTDMS itself keeps the last start of each channel.

    It has to be made before the file is opened.
    """

    def __init__(self) -> None:
        from nptdms.reader import TdmsReader

        self._said: dict[str, list[tuple[int, Any]]] = defaultdict(list)
        # The library has no other place where the properties of one segment can be seen.
        update, said = TdmsReader._update_object_properties, self._said

        def watched(reader: Any, properties: Any) -> None:
            for path, listed in (properties or {}).items():
                said[path] += [(len(reader._segments), value) for key, value in listed if key == "wf_start_time"]
            update(reader, properties)

        TdmsReader._update_object_properties = watched

    def stamps(self, file: Any, channels: list[Any]) -> list[Callable[[], np.ndarray] | None]:
        """For every channel its stamps [s], counted from the earliest start of the file; None without a step."""
        pieces = [self._pieces(file, channel) for channel in channels]
        starts = {start for found in pieces for _, start in found}
        return [_stamps(channel, found, starts) for channel, found in zip(channels, pieces, strict=True)]

    def _pieces(self, file: Any, channel: Any) -> list[tuple[int, np.datetime64]]:
        """Number of the first sample and start of every piece of a recording; none where no start is said."""
        found = []
        for segment, value in self._said.get(channel.path, ()):
            start = value.as_datetime64("us") if hasattr(value, "as_datetime64") else value
            if isinstance(start, np.datetime64) and not np.isnat(start) and start.astype("i8"):
                found.append((segment, start))
        if not len(channel):
            return []
        if len({start for _, start in found}) < 2:
            return [(0, start) for _, start in found[:1]]
        counts = np.cumsum([0, *(_count(segment, channel.path) for segment in file._reader._segments)])
        return [(int(counts[segment]), start) for segment, start in found]


def _count(segment: Any, path: str) -> int:
    """Number of values of a channel in a segment."""
    from nptdms.reader import _number_of_segment_values

    return sum(int(_number_of_segment_values(one, segment)) for one in segment.ordered_objects if one.path == path)


def _stamps(
    channel: Any, pieces: list[tuple[int, np.datetime64]], starts: set[np.datetime64]
) -> Callable[[], np.ndarray] | None:
    properties, path = channel.properties, f"{channel.group_name}/{channel.name}"
    step = properties.get("wf_increment")
    if not isinstance(step, Real) or not step:
        return None
    if not pieces and len(starts) > 1:
        return no_time(
            RefusedError(
                f"has no wf_start_time for '{shorten(path)}', and others begin at different times; export it again"
            )
        )
    what, unit = (str(properties.get(key) or "") for key in ("wf_xname", "wf_xunit_string"))
    try:
        factor = axis_seconds(what, unit, path)
    except RefusedError as error:
        return no_time(error)
    offset_s, step_s = factor * float(properties.get("wf_start_offset", 0.0) or 0.0), factor * float(step)
    begins = [(number, offset_s + float((start - min(starts)) / _NANOSECOND) * 1e-9) for number, start in pieces]
    joined: list[tuple[int, float]] = []
    for number, begin_s in begins or [(0, offset_s)]:
        # A piece that goes on where the one before ended is none of its own: writers repeat the start with every piece.
        goes_on = bool(joined) and abs(joined[-1][1] + (number - joined[-1][0]) * step_s - begin_s) <= 0.5 * step_s
        if not goes_on:
            joined.append((number, begin_s))
    if len(joined) == 1:
        stamps: Callable[[], np.ndarray] = even_time(joined[0][1], step_s, len(channel))
        return stamps
    ends = [number for number, _ in joined[1:]] + [len(channel)]
    return lambda: np.concatenate(
        [begin_s + step_s * np.arange(end - number) for (number, begin_s), end in zip(joined, ends, strict=True)]
    )
