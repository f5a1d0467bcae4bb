"""File and variable names made from user text: safe on every file system and in every HDF5 reader."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import TYPE_CHECKING

from sysid.tabular import distinct

if TYPE_CHECKING:
    from sysid.prediction.predicted_passes import PassPrediction


#: Characters of a file name made from a text.
_LONGEST_NAME = 60


def file_stem(text: str) -> str:
    """`text` with all but letters a-z, digits, ``-``, ``_`` replaced by ``_``; never empty, at most 60 characters."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9_-]+", "_", plain).strip("_-")[:_LONGEST_NAME] or "pass"


def speed_km_h(speed_m_s: float) -> float:
    """Speed in km/h without the rounding noise of the conversion, so that 48 km/h read comes out as 48."""
    return round(float(speed_m_s) * 3.6, 9)


def prediction_files(passes: Iterable[PassPrediction]) -> tuple[str, ...]:
    """File of every predicted pass relative to the output folder, like ``predictions/unloaded_48kmh.csv``."""
    stems = (
        f"{file_stem(p.load_case)}_{speed_km_h(p.speed_m_s):g}kmh" + (f"_{file_stem(p.shape)}" if p.shape else "")
        for p in passes
    )
    return tuple(f"predictions/{stem}.csv" for stem in distinct(stems))
