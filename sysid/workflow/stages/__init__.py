"""All stages of a calibration, in the order in which they run and in which the command line lists them.

To add a stage, write its record in a module of this package and name it here.
"""

from __future__ import annotations

from typing import Any

from sysid.workflow.stage import Ending, Stage
from sysid.workflow.stages.balance import BALANCE
from sysid.workflow.stages.data import CHECK, DROPS, SCAN
from sysid.workflow.stages.endings import EXPORT, REPORT, SUMMARY
from sysid.workflow.stages.estimates import ESTIMATES
from sysid.workflow.stages.fit import FIT, LEFT_OUT, PROFILE, VALIDATE
from sysid.workflow.stages.loads import ADVISE, DRIVEN, PREDICT
from sysid.workflow.stages.posterior import BANDS, SAMPLE

STAGES: tuple[Stage[Any], ...] = (
    CHECK,
    DROPS,
    BALANCE,
    SCAN,
    FIT,
    LEFT_OUT,
    VALIDATE,
    PROFILE,
    SAMPLE,
    BANDS,
    ESTIMATES,
    DRIVEN,
    PREDICT,
    ADVISE,
)
ENDINGS: tuple[Ending, ...] = (REPORT, EXPORT)
#: Whatever may have a command of its own.
RECORDS: tuple[Stage[Any] | Ending, ...] = (*STAGES, *ENDINGS)

__all__ = [
    "ADVISE",
    "BALANCE",
    "BANDS",
    "CHECK",
    "DRIVEN",
    "DROPS",
    "ENDINGS",
    "ESTIMATES",
    "EXPORT",
    "FIT",
    "LEFT_OUT",
    "PREDICT",
    "PROFILE",
    "RECORDS",
    "REPORT",
    "SAMPLE",
    "SCAN",
    "STAGES",
    "SUMMARY",
    "VALIDATE",
]
