"""SI units of parameters by their names."""

from __future__ import annotations

from sysid.estimation.parameters.suspension_elements import ELEMENTS

_UNITS = {"k": "N/m", "c": "N s/m", "kt": "N/m", "ct": "N s/m"}
_UNITS |= {quantity.symbol: quantity.unit for element in ELEMENTS.values() for quantity in element.quantities}


def parameter_unit(name: str) -> str:
    """SI unit of a parameter such as ``k_2[loaded]``; empty for a name that is none of an axle's laws."""
    symbol = name.split("[")[0]
    return _UNITS.get(symbol) or _UNITS.get(symbol.rpartition("_")[0], "")
