"""Profiles in ERD files of profilometers, as text.

A header of lines that begin with keywords of eight characters ends with END; numbers follow, one line per station.  Its
second line holds NCHAN, NSAMP, NRECS, NBYTES, KEYNUM, STEP and KEYOPT: channels, samples, storage (KEYNUM 5 is text)
and the distance of the stations.  Names and units of the channels stand in fields of eight characters.

Source: M. W. Sayers, S. M. Karamihas, "ERD file format for storage and analysis of road profiles", UMTRI; files of the
Long-Term Pavement Performance programme.
"""

from __future__ import annotations

import re

import numpy as np

from sysid.campaign.units import length_in_m
from sysid.errors import DataRejectedError
from sysid.logs.channels import LARGEST
from sysid.logs.input_file import InputFile
from sysid.wording import shorten

#: How an ERD file begins.
MARK = b"ERDFILEV"
_FIELD = 8
_TEXT = 5
#: Names of the channels of both wheel tracks, as LElev. and RElev., or left profile.
_SIDES = (re.compile(r"l(eft)?[\W_]*(e|p|w|$)", re.IGNORECASE), re.compile(r"r(ight)?[\W_]*(e|p|w|$)", re.IGNORECASE))


def read_erd(source: InputFile, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Stations (n,) and heights (tracks, n) [m] of the left and the right wheels, or of the only track.

    Raises
    ------
    DataRejectedError
        If the numbers are binary, units are missing, or it is not known which channels are the tracks.
    """
    text = source.data.decode("latin-1")
    lines = re.split(r"\r?\n", text, maxsplit=2)
    head, end = lines[1] if len(lines) > 1 else "", re.search(r"^END\s*$", text, re.MULTILINE)
    numbers = [part.strip() for part in head.split(",") if part.strip()]
    try:
        channels, samples, kind, step = int(numbers[0]), int(numbers[1]), int(numbers[4]), float(numbers[5])
    except (IndexError, ValueError):
        raise DataRejectedError(
            f"{label}: line 2 of an ERD file has seven numbers, NCHAN, NSAMP, NRECS, NBYTES, KEYNUM, STEP, KEYOPT; "
            f"here it is '{shorten(head, 60)}'."
        ) from None
    if kind != _TEXT:
        raise DataRejectedError(
            f"{label} holds binary numbers (KEYNUM {kind}); write it as text (KEYNUM 5), or export a CSV table."
        )
    if end is None:
        raise DataRejectedError(f"{label} has no line END behind its header; it is cut off, or no ERD file.")
    keywords: dict[str, str] = {}
    for line in re.split(r"\r?\n", text[: end.start()])[2:]:
        keywords.setdefault(line[:_FIELD].strip().upper(), line[_FIELD:].rstrip())
    if scaled := next((key for key in keywords if key.startswith(("GAIN", "OFFS", "SCALE"))), None):
        raise DataRejectedError(f"{label} has {scaled} in its header, which is not applied here; export a CSV table.")
    values = np.array(_numbers(text[end.end() :], label))
    if channels < 1 or step <= 0.0 or values.size % channels or (samples > 0 and values.size != channels * samples):
        raise DataRejectedError(
            f"{label} says {channels} channels of {samples} samples, {step:g} apart, and holds {values.size} numbers; "
            "it is damaged or cut off."
        )
    table = values.reshape(-1, channels)
    if not (np.abs(values) < LARGEST).all():
        row = int(np.flatnonzero(~(np.abs(table) < LARGEST).all(axis=1))[0])
        raise DataRejectedError(f"{label}: sample {row + 1} has a missing height; every station needs one.")
    tracks = _tracks(channels, _fields(keywords.get("SHORTNAM", "")), label)
    along = _metres(keywords.get("XUNITS", "").strip(), "XUNITS", label)
    units = _fields(keywords.get("UNITSNAM", ""))
    units += [""] * (channels - len(units))
    height = np.array([table[:, k] * _metres(units[k], f"UNITSNAM of channel {k + 1}", label) for k in tracks])
    return along * step * np.arange(len(table)), height


def _numbers(body: str, label: str) -> list[float]:
    try:
        return [float(word) for word in re.split(r"[\s,]+", body.strip()) if word]
    except ValueError as error:
        raise DataRejectedError(f"{label}: a value behind END is no number ({shorten(str(error), 80)}).") from None


def _fields(text: str) -> list[str]:
    return [text[k : k + _FIELD].strip() for k in range(0, len(text), _FIELD)]


def _tracks(channels: int, names: list[str], label: str) -> list[int]:
    """Which channels are the left and the right track; the only one, or two without names."""
    if channels == 1:
        return [0]
    sides = [[k for k, name in enumerate(names[:channels]) if side.match(name)] for side in _SIDES]
    if all(len(of_side) == 1 for of_side in sides):
        return [sides[0][0], sides[1][0]]
    if channels == 2 and not any(names):
        return [0, 1]
    said = ", ".join(shorten(name, 12) for name in names[:channels] if name) or "no names"
    raise DataRejectedError(
        f"{label} has {channels} channels ({said}), and it is not clear which are the left and the right track; name "
        "them LElev. and RElev. in SHORTNAM, or keep one."
    )


def _metres(unit: str, where: str, label: str) -> float:
    factor = length_in_m(unit) if unit else None
    if factor is None:
        said = f"'{shorten(unit, 20)}'" if unit else "missing"
        raise DataRejectedError(f"{label}: {where} is {said}; write a unit of length, for example m, mm, ft or in.")
    return factor
