"""Results that show themselves as a table: ``summary()`` in SI units for analysis, shown in kN, mm and km/h."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, ClassVar

from sysid.display import shown_unit

if TYPE_CHECKING:
    import pandas as pd

#: SI unit of columns that are known by the end of their names, before that of a quantile.
_ENDINGS = {"N_s_per_m": "N s/m", "N_per_m": "N/m", "N": "N"}
#: The same of whole names, of lengths of millimetres only, and what people read where that is not the unit of a damper.
_COLUMNS = dict.fromkeys(("stiffness", "stiffness_sd"), "N/m") | dict.fromkeys(("damping", "damping_sd"), "N s/m")
_COLUMNS |= dict.fromkeys(("friction_force", "friction_force_sd"), "N")
_MILLIMETRES = ("height", "height_sd", "noise_rms", "tire_deflection", "jounce", "rebound", "extension")
_COLUMNS |= {f"{name}_m": "m" for name in _MILLIMETRES} | {"speed_m_s": "m/s"}
_SPEED = (3.6, "km/h")


class Tabular(ABC):
    """A result with a table of its main numbers."""

    #: Columns of the summary in the unit of their row.
    _in_row_unit: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Keep dataclasses from printing all their arrays: they take a `__repr__` that is there."""
        super().__init_subclass__(**kwargs)
        cls.__repr__ = Tabular.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        style: dict[str, Any] = {"max_rows": 12, "line_width": 120, "index": False, "na_rep": "-"}
        return f"{type(self).__name__}\n{self.shown().to_string(float_format=_digits, **style)}"

    @abstractmethod
    def summary(self) -> pd.DataFrame:
        """Table of the main numbers in SI units, axles counted from 1."""

    def to_pandas(self) -> pd.DataFrame:
        """Everything that fits into one table, in SI units: more than the summary where there is more."""
        return self.summary()

    def shown(self) -> pd.DataFrame:
        """The summary as it is printed: in kN, mm and km/h, named in brackets or in the column ``unit``."""
        table = self.summary()
        units = self._row_units(table)
        if units is not None:
            known = [shown_unit(unit) for unit in units]
            factors = [factor for factor, _ in known]
            for column in self._in_row_unit:
                table[column] = table[column].astype(float) * factors
            if "unit" not in table:
                table.insert(list(table.columns).index(self._in_row_unit[0]), "unit", "")
            table["unit"] = [name for _, name in known]
        for column in table.columns:
            head, factor = _head(str(column))
            if factor != 1.0 or head != column:
                table[column] = table[column].astype(float) * factor
        return table.rename(columns=lambda column: _head(str(column))[0])

    def _row_units(self, table: pd.DataFrame) -> Sequence[str] | None:
        """SI unit of every row of the summary; None where a row has several."""
        return list(table["unit"]) if "unit" in table else None

    def _repr_html_(self) -> str:
        return self.shown().to_html(float_format=_digits, na_rep="", index=False)


def _head(column: str) -> tuple[str, float]:
    """How a column is headed where it is shown, and the factor on its numbers."""
    stem, quantile = re.fullmatch(r"(.*?)((?:_q\d\d)?)", column).groups()  # type: ignore[union-attr]
    unit = _COLUMNS.get(stem)
    if unit is None:
        unit = next((u for end, u in _ENDINGS.items() if stem.endswith(f"_{end}")), None)
    if unit is None:
        return column, 1.0
    factor, name = _SPEED if unit == "m/s" else shown_unit(unit)
    stem = re.sub(r"_(N_s_per_m|N_per_m|N|m_s|m)$", "", stem)
    return f"{stem}{quantile} [{name}]", factor


def _digits(number: float) -> str:
    """Five digits, without an exponent where there are fewer than seven before the point."""
    text = f"{number:.5g}"
    return f"{number:.0f}" if "e+0" in text and abs(number) < 1e7 else text


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
