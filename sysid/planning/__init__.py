"""What to measure next: runs, sensors and masses ranked by what they would bring."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.planning.advice_records import Advice
    from sysid.planning.ranking import CANDIDATE_KM_H, advise

_HOMES = {
    "Advice": "sysid.planning.advice_records",
    "CANDIDATE_KM_H": "sysid.planning.ranking",
    "advise": "sysid.planning.ranking",
}

__all__ = ["CANDIDATE_KM_H", "Advice", "advise"]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
