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

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Keep dataclasses from printing all their arrays: they take a `__repr__` that is there."""
        super().__init_subclass__(**kwargs)
        cls.__repr__ = Tabular.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return f"{type(self).__name__}\n{self.summary().to_string(max_rows=12, line_width=120, index=False)}"

    @abstractmethod
    def summary(self) -> pd.DataFrame:
        """Table of the main numbers in SI units, axles counted from 1."""

    def to_pandas(self) -> pd.DataFrame:
        """Everything that fits into one table, in SI units: more than the summary where there is more."""
        return self.summary()

    def _repr_html_(self) -> str:
        return self.summary().to_html(float_format="{:.5g}".format, na_rep="", index=False)


def distinct(names: Iterable[str]) -> tuple[str, ...]:
    """`names` with ``_2``, ``_3``, ... appended to repetitions."""
    taken: set[str] = set()
    result = []
    for name in names:
        candidate, count = name, 1
        while candidate in taken:
            count += 1
            candidate = f"{name}_{count}"
        taken.add(candidate)
        result.append(candidate)
    return tuple(result)


def band_columns(name: str, bands: Iterable[Any], values: int) -> dict[str, Any]:
    """Columns ``name_q05``, ``name_q50``, ``name_q95`` of `values` numbers each; NaN where a quantile is not known."""
    import numpy as np

    return {
        f"{name}_{key}": np.full(values, np.nan) if band is None else np.asarray(band)
        for key, band in zip(("q05", "q50", "q95"), bands, strict=True)
    }


def records_table(records: Iterable[Any], columns: tuple[str, ...]) -> pd.DataFrame:
    """Table of chosen fields of dataclass records; axle indices become axle numbers."""
    # pandas takes a quarter of a second to import; results without a table do not pay for it.
    import pandas as pd

    table = pd.DataFrame([asdict(r) for r in records]).reindex(columns=list(columns))
    if "axle" in columns:
        table["axle"] = pd.array([None if pd.isna(a) else int(a) + 1 for a in table["axle"]], dtype="Int64")
    return table
