"""Results that show themselves as a table: ``summary()`` for analysis, ``_repr_html_`` for notebooks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


class Tabular(ABC):
    """A result with a table of its main numbers."""

    @abstractmethod
    def summary(self) -> pd.DataFrame:
        """Table of the main numbers in SI units, axles counted from 1."""

    def _repr_html_(self) -> str:
        return self.summary().to_html(float_format="{:.5g}".format, na_rep="", index=False)


def records_table(records: Iterable[Any], columns: tuple[str, ...]) -> pd.DataFrame:
    """Table of chosen fields of dataclass records; axle indices become axle numbers."""
    # pandas takes a quarter of a second to import; results without a table do not pay for it.
    import pandas as pd

    table = pd.DataFrame([asdict(r) for r in records]).reindex(columns=list(columns))
    if "axle" in columns:
        table["axle"] = pd.array([None if pd.isna(a) else int(a) + 1 for a in table["axle"]], dtype="Int64")
    return table
