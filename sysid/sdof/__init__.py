"""Plank drops: peaks, damped period and decrement, stiffness and damping per axle by equations (1)-(3) and beyond."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.sdof.analysis import analyse_drop
    from sysid.sdof.damping_law import fit_damping_law
    from sysid.sdof.decay import prepare_record, read_decay
    from sysid.sdof.drop_results import DampingLaw, DecayReading, DropAnalysis, DropEstimate, DropMethod, DropSummary
    from sysid.sdof.equations import (
        corrected_damping,
        corrected_stiffness,
        damping_ratio_from_decrement,
        decrement_from_damping_ratio,
        directive_damping,
        exact_damping,
        exact_stiffness,
        invert_quarter_car,
        log_decrement,
        paper_damping,
        paper_stiffness,
        series_damping,
        series_stiffness,
    )
    from sysid.sdof.settings import DropSettings
    from sysid.sdof.summary import analyse_drops, summary_table

_HOMES = {
    "DampingLaw": "sysid.sdof.drop_results",
    "DecayReading": "sysid.sdof.drop_results",
    "DropAnalysis": "sysid.sdof.drop_results",
    "DropEstimate": "sysid.sdof.drop_results",
    "DropMethod": "sysid.sdof.drop_results",
    "DropSettings": "sysid.sdof.settings",
    "DropSummary": "sysid.sdof.drop_results",
    "analyse_drop": "sysid.sdof.analysis",
    "analyse_drops": "sysid.sdof.summary",
    "corrected_damping": "sysid.sdof.equations",
    "corrected_stiffness": "sysid.sdof.equations",
    "damping_ratio_from_decrement": "sysid.sdof.equations",
    "decrement_from_damping_ratio": "sysid.sdof.equations",
    "directive_damping": "sysid.sdof.equations",
    "exact_damping": "sysid.sdof.equations",
    "exact_stiffness": "sysid.sdof.equations",
    "fit_damping_law": "sysid.sdof.damping_law",
    "invert_quarter_car": "sysid.sdof.equations",
    "log_decrement": "sysid.sdof.equations",
    "paper_damping": "sysid.sdof.equations",
    "paper_stiffness": "sysid.sdof.equations",
    "prepare_record": "sysid.sdof.decay",
    "read_decay": "sysid.sdof.decay",
    "series_damping": "sysid.sdof.equations",
    "series_stiffness": "sysid.sdof.equations",
    "summary_table": "sysid.sdof.summary",
}

__all__ = [
    "DampingLaw",
    "DecayReading",
    "DropAnalysis",
    "DropEstimate",
    "DropMethod",
    "DropSettings",
    "DropSummary",
    "analyse_drop",
    "analyse_drops",
    "corrected_damping",
    "corrected_stiffness",
    "damping_ratio_from_decrement",
    "decrement_from_damping_ratio",
    "directive_damping",
    "exact_damping",
    "exact_stiffness",
    "fit_damping_law",
    "invert_quarter_car",
    "log_decrement",
    "paper_damping",
    "paper_stiffness",
    "prepare_record",
    "read_decay",
    "series_damping",
    "series_stiffness",
    "summary_table",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
