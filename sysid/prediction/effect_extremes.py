"""Extremes and histories of load effects: of some draws over one surface, and of all of them together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid.bridge.code_vehicles import LOAD_MODELS, model_effect
from sysid.bridge.description import made_bridge
from sysid.bridge.moving import Crossing, EffectTimes
from sysid.bridge.structure import EFFECT_UNITS, Bridge
from sysid.campaign.bridges import BridgeCourse, BridgeDescription
from sysid.prediction.bridge_effects import BridgeLoads, CodeEffect, LoadEffect, Sense
from sysid.prediction.measures import quantiles
from sysid.prediction.quantiles import Quantiles

#: Both senses of an effect, in the order of the arrays below.
_SENSES: tuple[tuple[Sense, float], ...] = (("largest", 1.0), ("least", -1.0))
#: An effect whose static extreme is a smaller share of that in the other sense is next to nothing.
_NEXT_TO_NOTHING = 0.02
#: Instants of stored histories at most, and stations of stored influence lines.
_HISTORY, _STATIONS = 1200, 401


@lru_cache(maxsize=20)
def bridge_of(description: BridgeDescription) -> Bridge:
    """The bridge of a description, made once."""
    return made_bridge(description)


@lru_cache(maxsize=1000)
def _code_effects(description: BridgeDescription, line: int, sense: float) -> tuple[CodeEffect, ...]:
    bridge = bridge_of(description)
    return tuple(CodeEffect(m.name, model_effect(bridge, bridge.lines[line], m, sense)) for m in LOAD_MODELS)


@dataclass(frozen=True)
class EffectExtremes:
    """Load effects of t draws over one surface: extremes in both senses (2, E, t), and histories (E, H, t).

    - `most`: of ``static``, ``rolling`` and ``dynamic`` effects (2, E, t);
    - `front_m` (2, E, t): where axle 1 is at the dynamic extreme; `together` (2, E, E, t): all effects there;
    - `static`, `dynamic` at the stored instants.
    """

    most: Mapping[str, np.ndarray]
    front_m: np.ndarray
    together: np.ndarray
    static: np.ndarray
    dynamic: np.ndarray


def stored_instants(times: EffectTimes) -> np.ndarray:
    """Numbers of the instants at which histories are stored."""
    count = times.sample.size
    return np.unique(np.linspace(0, count - 1, min(_HISTORY, count)).astype(int))


def effect_extremes(effects: Mapping[str, np.ndarray], front_m: np.ndarray, stored: np.ndarray) -> EffectExtremes:
    """Extremes of load effects (E, m, t) by name: ``static``, ``rolling`` and ``dynamic``.

    Parameters
    ----------
    front_m : (m,) places of axle 1. stored : numbers of the instants whose values are kept.
    """
    dynamic = effects["dynamic"]
    most = {name: np.stack([e.max(axis=1), e.min(axis=1)]) for name, e in effects.items()}
    # The first instant at the extreme: numbers would be copied for `argmax` along any axis but the last.
    at = np.stack([(dynamic == extreme[:, None]).argmax(axis=1) for extreme in most["dynamic"]])
    effect, draw = np.arange(dynamic.shape[0]), np.arange(dynamic.shape[2])
    return EffectExtremes(
        most,
        front_m[at],
        # All effects at the instant of each extreme.
        dynamic[effect[:, None], at[:, :, None], draw],
        effects["static"][:, stored],
        dynamic[:, stored].astype(np.float32),
    )


def bridge_loads(
    course: BridgeCourse,
    times: EffectTimes,
    crossing: Crossing,
    found: Sequence[EffectExtremes],
    first: Sequence[EffectExtremes],
    rounds: int,
) -> BridgeLoads:
    """Load effects of all draws over all surfaces.

    Parameters
    ----------
    found : of all draws and surfaces; first : of all draws over the first surface, of which histories are.
    rounds : of vehicle and deck in turn.
    """
    bridge = bridge_of(course.bridge)
    station = np.linspace(0.0, bridge.length_m, _STATIONS)
    instants = stored_instants(times)
    static, dynamic = (
        quantiles(np.moveaxis(np.concatenate([getattr(f, name) for f in first], axis=-1), 0, 1))
        for name in ("static", "dynamic")
    )
    low, middle, high = (None if q is None else np.asarray(q.T, float) for q in (dynamic.q05, dynamic.q50, dynamic.q95))
    assert middle is not None
    return BridgeLoads(
        bridge=bridge.name,
        length_m=bridge.length_m,
        surface="" if course.surface is None else course.surface.label,
        vehicles=course.vehicles,
        gap_m=course.gap_m,
        names=tuple(line.name for line in bridge.lines),
        units=tuple(EFFECT_UNITS[line.kind] for line in bridge.lines),
        station_m=station,
        influence=np.stack([line.curve.at(station) for line in bridge.lines]),
        effects=_load_effects(course.bridge, found),
        time_s=crossing.interval_s * (times.sample + times.share)[instants],
        static=static.q50.T,
        history=Quantiles(low, middle, high),
        frequency_hz=np.zeros(0) if bridge.modes is None else bridge.modes.frequency_hz,
        rounds=rounds,
    )


def _load_effects(description: BridgeDescription, found: Sequence[EffectExtremes]) -> tuple[LoadEffect, ...]:
    """Largest and least value of every load effect, draw by draw and surface by surface."""
    bridge = bridge_of(description)
    most = {name: np.concatenate([f.most[name] for f in found], axis=-1) for name in ("static", "rolling", "dynamic")}
    front, together = (np.concatenate([getattr(f, n) for f in found], axis=-1) for n in ("front_m", "together"))
    effects = []
    for number, line in enumerate(bridge.lines):
        size = np.abs(np.median(most["static"][:, number], axis=-1))
        for k, (sense, sign) in enumerate(_SENSES):
            if size[k] <= _NEXT_TO_NOTHING * size.max():
                continue
            static, rolling, dynamic = (most[name][k, number] for name in ("static", "rolling", "dynamic"))
            effects.append(
                LoadEffect(
                    line=number,
                    name=line.name,
                    kind=line.kind,
                    unit=EFFECT_UNITS[line.kind],
                    sense=sense,
                    static=quantiles(static[None]),
                    rolling=quantiles(rolling[None]),
                    dynamic=quantiles(dynamic[None]),
                    amplification=quantiles((dynamic / static)[None]),
                    front_m=float(np.median(front[k, number])),
                    concurrent=np.median(together[k, number], axis=1),
                    codes=_code_effects(description, number, sign),
                )
            )
    return tuple(effects)
