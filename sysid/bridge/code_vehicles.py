"""Load models of bridge codes: axles, loads along the lane and dynamic allowances, with their sources.

A load model is what one lane bears, characteristic (without partial factors).  Loads along the lane act where they add
to the effect.  Axles that would reduce it are left out of the trucks of AASHTO and CSA; other trains are whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.bridge.structure import Bridge, InfluenceLine

#: Step of a load model along the bridge [m] beside the positions at which an axle stands at a corner of the line.
_STEP_M = 0.1
#: Points of the quadrature of Gauss per piece of an influence line.
_POINTS = 4


@dataclass(frozen=True)
class AxleTrain:
    """Axles one behind the other: loads [kN] and distances behind the first one [m].

    `factor` multiplies the loads: the dynamic allowance, or the share of the train that counts.  Of a train that is not
    `whole`, axles that reduce the effect are left out.
    """

    load_kN: tuple[float, ...]
    x_m: tuple[float, ...]
    factor: float = 1.0
    whole: bool = True


@dataclass(frozen=True)
class LoadModel:
    """A code's load model: the worst of combinations of a train of axles and a load along the lane [kN/m].

    Trains drive in both directions.  `hogging` are combinations for hogging moments alone.
    """

    name: str
    source: str
    combinations: tuple[tuple[AxleTrain, float], ...]
    hogging: tuple[tuple[AxleTrain, float], ...] = ()


def _behind(*steps_m: float) -> tuple[float, ...]:
    return (0.0, *np.cumsum(steps_m).tolist())


def _hl93() -> LoadModel:
    tandem = AxleTrain((110.0, 110.0), (0.0, 1.2), 1.33, whole=False)
    truck = (35.0, 145.0, 145.0)
    trucks = [AxleTrain(truck, _behind(4.3, rear), 1.33, whole=False) for rear in np.linspace(4.3, 9.0, 6)]
    pairs = [
        AxleTrain(truck * 2, _behind(4.3, 4.3, gap, 4.3, 4.3), 0.9 * 1.33, whole=False)
        for gap in np.arange(15.0, 60.0, 5.0)
    ]
    return LoadModel(
        "HL-93",
        "AASHTO LRFD, 3.6.1.2, 3.6.1.3 and 3.6.2.1: truck or tandem with 33 % allowance, and lane of 9.3 kN/m; for "
        "hogging moments also nine tenths of two trucks 15 m or more apart and of the lane",
        tuple((train, 9.3) for train in (tandem, *trucks)),
        tuple((train, 0.9 * 9.3) for train in pairs),
    )


def _m1600() -> LoadModel:
    def train(gap: float) -> AxleTrain:
        return AxleTrain((120.0,) * 12, _behind(1.25, 1.25, 3.75, 1.25, 1.25, gap, 1.25, 1.25, 5.0, 1.25, 1.25), 1.3)

    return LoadModel(
        "M1600",
        "AS 5100.2:2017, 7.2.3 and table 7.7.2: twelve axles of 120 kN in four groups, gap of 6.25 m or more, with "
        "30 % allowance, and 6 kN/m with the same",
        tuple((train(gap), 1.3 * 6.0) for gap in np.arange(6.25, 40.0, 2.5)),
    )


def _cl625() -> LoadModel:
    load, x = (50.0, 125.0, 125.0, 175.0, 150.0), _behind(3.6, 1.2, 6.6, 6.6)
    parts = [
        (AxleTrain(load[a:b], tuple(p - x[a] for p in x[a:b]), 1.0 + allowance, whole=False), 0.0)
        for a, b, allowance in ((3, 4, 0.4), (1, 3, 0.3), (0, 3, 0.3), (0, 5, 0.25), (1, 5, 0.25), (0, 4, 0.25))
    ]
    return LoadModel(
        "CL-625",
        "CSA S6, 3.8.3 and 3.8.4.5: truck of 625 kN with an allowance of 40 % for one axle, 30 % for two or for axles "
        "1 to 3, 25 % for more; or four fifths of it and 9 kN/m",
        (*parts, (AxleTrain(load, x, 0.8, whole=False), 9.0)),
    )


#: Load models by name.
LOAD_MODELS: tuple[LoadModel, ...] = (
    LoadModel(
        "LM1",
        "EN 1991-2:2003, 4.3.2: tandem of two axles of 300 kN and 9 kN/m2 on lane 1 of 3 m, adjustment factors 1; the "
        "allowance is in the loads",
        ((AxleTrain((300.0, 300.0), (0.0, 1.2)), 27.0),),
    ),
    _hl93(),
    _cl625(),
    _m1600(),
    LoadModel(
        "HB 45",
        "BS 5400-2:2006, 6.3: four axles of 45 units of 10 kN, 1.8 m, 6 to 26 m and 1.8 m apart; the allowance is "
        "in the loads",
        tuple((AxleTrain((450.0,) * 4, _behind(1.8, inner, 1.8)), 0.0) for inner in (6.0, 11.0, 16.0, 21.0, 26.0)),
    ),
)


def train_effect(line: InfluenceLine, load_N: Sequence[float], x_m: Sequence[float], length_m: float) -> float:
    """Largest effect of axles of constant load anywhere on a bridge, in either direction.

    Parameters
    ----------
    load_N, x_m : loads and distances behind the first axle (na,).
    """
    load = np.asarray(load_N, float)
    return max(float(_along(line, load, x, length_m, False).max()) for x in _both_ways(load, x_m))


def model_effect(bridge: Bridge, line: InfluenceLine, model: LoadModel, sense: float = 1.0) -> float:
    """Characteristic effect of a load model, the largest in a sense (+1, or -1 for the least), with its allowances.

    Raises
    ------
    ValueError
        If the sense is neither +1 nor -1.
    """
    if sense not in (1.0, -1.0):
        raise ValueError(f"The sense of an effect is +1 or -1, not {sense:g}.")
    lane = _lane(line, sense)
    more = model.hogging if line.kind == "moment" and sense < 0.0 else ()
    return sense * max(
        _worst_train(line, train, bridge.length_m, sense) + 1e3 * along * lane
        for train, along in (*model.combinations, *more)
    )


def _both_ways(load_N: np.ndarray, x_m: Sequence[float]) -> Iterator[np.ndarray]:
    """Distances behind the first axle in either direction, once where both are the same."""
    x = np.asarray(x_m, float)
    yield x
    if not (np.array_equal(load_N, load_N[::-1]) and np.allclose(x[-1] - x[::-1], x, rtol=0.0, atol=1e-9)):
        yield x[-1] - x


def _worst_train(line: InfluenceLine, train: AxleTrain, length_m: float, sense: float) -> float:
    load = 1e3 * train.factor * np.array(train.load_kN)
    return max(
        float(_along(line, sense * load, x, length_m, not train.whole).max(initial=0.0))
        for x in _both_ways(load, train.x_m)
    )


def _along(line: InfluenceLine, load_N: np.ndarray, x_m: np.ndarray, length_m: float, adverse: bool) -> np.ndarray:
    """Effects with the first axle at many places: every step, and where an axle stands at a corner of the line."""
    corners = [0.0, length_m, *(c for c in (line.station_m,) if c is not None)]
    ends = np.array([0.0, length_m + float(np.max(x_m))])
    places = np.concatenate(
        [
            np.arange(ends[0], ends[1], _STEP_M),
            *(np.array([c - 1e-9, c + 1e-9]) + x for c in corners for x in x_m[:, None]),
        ]
    )
    found = line.curve.at(places[:, None] - x_m) * load_N
    return np.asarray((np.maximum(found, 0.0) if adverse else found).sum(axis=1))


def _lane(line: InfluenceLine, sense: float) -> float:
    """Integral of the part of an influence line of one sense [its unit per N/m]."""
    breaks = line.curve.breaks_m
    finer = np.unique(np.concatenate([breaks, np.linspace(breaks[0], breaks[-1], 2001)]))
    point, weight = np.polynomial.legendre.leggauss(_POINTS)
    middle, half = 0.5 * (finer[1:] + finer[:-1]), 0.5 * np.diff(finer)
    values = sense * line.curve.at(middle[:, None] + half[:, None] * point)
    return float((half[:, None] * weight * np.maximum(values, 0.0)).sum())
