"""What the records show that the campaign file does not say: kinds of causes, and one cause in a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

#: What may lie behind records that the declared truck does not explain: physics of its suspensions, a bump that is not
#: as scanned, a part on springs of its own, declared masses, and how sensors, axles and runs are entered.
CauseKind = Literal[
    "friction",
    "leaf",
    "helper",
    "bushing",
    "damper",
    "air_spring",
    "stops",
    "bump",
    "links",
    "own_springs",
    "mass",
    "sensor",
    "clock",
    "place",
    "load_case",
]


@dataclass(frozen=True)
class Cause:
    """Something that the campaign file does not say and the records show: its `kind`, and a `sentence` about it.

    What is `modelled` is in the calibrated model.
    """

    kind: CauseKind
    sentence: str
    modelled: bool = False


def beside_mistakes(mistakes: Sequence[Cause], others: Sequence[Cause]) -> tuple[Cause, ...]:
    """What else may be named: physics that the model took up beside a mistake that it lacks may only imitate it."""
    return tuple(c for c in others if not (mistakes and c.modelled))
