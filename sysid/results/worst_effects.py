"""Which pass over a bridge is the worst for each load effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sysid.prediction.bridge_effects import LoadEffect
    from sysid.prediction.predicted_passes import PassPrediction


def worst_effects(passes: Sequence[PassPrediction]) -> dict[str, tuple[PassPrediction, LoadEffect]]:
    """Load effects of passes over one bridge by title, each with the pass in which it is at its extreme."""
    worst: dict[str, tuple[PassPrediction, LoadEffect]] = {}
    for p in passes:
        for e in () if p.bridge is None else p.bridge.effects:
            if e.title not in worst or e.size > worst[e.title][1].size:
                worst[e.title] = p, e
    return worst
