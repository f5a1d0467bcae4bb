"""Plank drops: peaks, damped period and decrement, stiffness and damping per axle by equations (1)-(3) and beyond."""

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
