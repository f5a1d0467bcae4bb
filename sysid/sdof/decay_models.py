"""Unknowns of a quarter car after its drop with their priors, and the models of it that are averaged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.sdof.quarter_car import QuarterCars

#: What every model has: the linear quarter car, how the sensor reads at rest, and the state where the fit begins.
_LINEAR = (
    "stiffness",
    "damping",
    "mass",
    "unsprung",
    "tire",
    "tire_damping",
    "level",
    "drift",
    "extension",
    "extension_rate",
    "wheel",
    "wheel_rate",
)
#: Elements beyond it, with the unknowns that each adds.
ELEMENTS = {
    "friction": ("friction", "slip", "stuck"),
    "progressive": ("bend", "cubic"),
    "asymmetric": ("asymmetry",),
    "quadratic": ("quadratic",),
    "mode": ("mode_omega", "mode_ratio", "mode_cosine", "mode_sine"),
}
#: Laws of the damper of which a model has one at most.
_EITHER = frozenset({"asymmetric", "quadratic"})

#: Unknowns in the order of a vector; those of `LOGARITHMIC` stand in it as logarithms.
UNKNOWNS = (*_LINEAR, *(name for names in ELEMENTS.values() for name in names))
PLACE = {name: index for index, name in enumerate(UNKNOWNS)}
LOGARITHMIC = [
    PLACE[n] for n in ("stiffness", "mass", "unsprung", "tire", "tire_damping", "slip", "mode_omega", "mode_ratio")
]
DECLARED = [PLACE[n] for n in ("mass", "unsprung", "tire", "tire_damping")]
_BESIDE = ("level", "drift", "mode_omega", "mode_ratio", "mode_cosine", "mode_sine")
#: Places of what is added to the motion of the quarter car.
BESIDE = [PLACE[n] for n in _BESIDE]

_LOWEST = {"damping": 0.0, "friction": 0.0, "stuck": -1.0, "asymmetry": -0.95}
_HIGHEST = {"stuck": 1.0, "asymmetry": 0.95}
_FARTHEST = 12.0  # prior standard deviations

Elements = frozenset[str]


def free(model: Elements) -> np.ndarray:
    """Which unknowns (u,) a model has."""
    names = {*_LINEAR, *(name for element in model for name in ELEMENTS[element])}
    return np.array([name in names for name in UNKNOWNS])


def next_to(model: Elements) -> list[Elements]:
    """Models with one element more, or with another law of the damper."""
    return [(model - _EITHER if e in _EITHER else model) | {e} for e in ELEMENTS if e not in model]


@dataclass(frozen=True)
class Priors:
    """Middle and standard deviation (u,) of every unknown, normal in the unknown or in its logarithm.

    x = (unknown - middle) / sd is what is searched for, between `lowest` and `highest` (u,).
    """

    middle: np.ndarray
    sd: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray

    @classmethod
    def of(cls, prior: dict[str, tuple[float, float]]) -> Priors:
        """From (middle, sd) by name; of a logarithmic unknown its median and the deviation of its logarithm."""
        middle, sd = (np.array([prior[n][i] for n in UNKNOWNS]) for i in (0, 1))
        middle[LOGARITHMIC] = np.log(middle[LOGARITHMIC])
        lowest, highest = np.full((2, middle.size), _FARTHEST) * [[-1.0], [1.0]]
        for bounds, by_name in ((lowest, _LOWEST), (highest, _HIGHEST)):
            for name, bound in by_name.items():
                bounds[PLACE[name]] = (bound - middle[PLACE[name]]) / sd[PLACE[name]]
        return cls(middle, sd, lowest, highest)

    def values(self, x: np.ndarray) -> np.ndarray:
        """Unknowns (m, u) in their units from x (m, u)."""
        values = self.middle + self.sd * x
        values[:, LOGARITHMIC] = np.exp(values[:, LOGARITHMIC])
        return np.asarray(values)

    def x(self, values: dict[str, float]) -> np.ndarray:
        """x (u,) of values by name, 0 where there is none."""
        x = np.zeros(len(UNKNOWNS))
        for name, value in values.items():
            i = PLACE[name]
            if self.sd[i] > 0.0:
                x[i] = ((np.log(value) if i in LOGARITHMIC else value) - self.middle[i]) / self.sd[i]
        return x


def motion(values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Extension (m, n) of the quarter cars with these unknowns (m, u), without what is beside them."""
    v = dict(zip(UNKNOWNS, values.T, strict=True))
    cars = QuarterCars(
        **{n: v[n] for n in ("mass", "unsprung", "tire", "tire_damping", "stiffness", "bend", "cubic")},
        **{n: v[n] for n in ("damping", "asymmetry", "quadratic", "slip", "stuck")},
        friction=v["friction"],
        start=np.stack([v["extension"], v["extension_rate"], v["wheel"], v["wheel_rate"]]),
    )
    return cars.extension(time_s)


def beside(values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Level, drift and further mode (m, n): x0 + d t + exp(-zeta omega t) (a cos omega t + b sin omega t)."""
    v = {n: values[:, PLACE[n], None] for n in _BESIDE}
    t = time_s - time_s[0]
    phase = v["mode_omega"] * t
    envelope = np.exp(-v["mode_ratio"] * phase)
    wave = v["mode_cosine"] * np.cos(phase) + v["mode_sine"] * np.sin(phase)
    return np.asarray(v["level"] + v["drift"] * t + envelope * wave)
