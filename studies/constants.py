"""What every constant that moves an interval does to k and c: ``python -m studies.constants CAMPAIGN ...``.

At the joint optimum of a finished fit, the normal equations are solved again with one constant halved or doubled. They
are those of :mod:`sysid.estimation.uncertainty.information`: data as linearised there, priors and scales of departures
as changed. So the step to the new optimum and its intervals come without another simulation; laws that would be chosen
otherwise, and what is not linear over the step, are not seen.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from studies.documents import write_between_marks
from sysid import Calibration
from sysid.estimation.fit import evaluation
from sysid.estimation.parameters import campaign_parameters as priors
from sysid.estimation.parameters import suspension_elements as elements
from sysid.estimation.parameters.parameter_set import Parameter
from sysid.estimation.residuals.bump_model import GAIN_SD
from sysid.estimation.uncertainty import departure_scale, departures, information
from sysid.estimation.uncertainty.allowances import Allowances

FACTORS = (0.5, 2.0)
_Arguments = tuple[Any, ...]


@dataclass(frozen=True)
class Optimum:
    """Log k and c of a fit (n,), and their standard deviations (n,), in the order of its parameters."""

    log_value: np.ndarray
    sd: np.ndarray


@dataclass(frozen=True)
class Constant:
    """One constant: its `value` in words, where it comes from, and how what the fit is given changes with it."""

    name: str
    value: str
    source: str
    change: Callable[[_Arguments, float], _Arguments]
    module: dict[str, float] | None = None
    key: str = ""
    own_data: bool = False


def _departure(kind: str, unit: str, source: str) -> Constant:
    value = f"{departure_scale.PLAUSIBLE[kind]:g}{unit}"
    name = f"largest scale of the departure `{kind}`"
    return Constant(name, value, source, lambda given, factor: given, departure_scale.PLAUSIBLE, kind)


def _tolerance(quantity: str, name: str, value: str, source: str) -> Constant:
    def change(given: _Arguments, factor: float) -> _Arguments:
        campaign, problem, vector, allowances, *rest = given
        masses = allowances.masses
        factors = tuple(replace(f, sd=factor * f.sd) if f.quantity == quantity else f for f in masses.factors)
        return (campaign, problem, vector, Allowances(replace(masses, factors=factors), allowances.departures), *rest)

    return Constant(name, value, source, change)


def _with_priors(given: _Arguments, changed: Callable[[Parameter], Parameter]) -> _Arguments:
    campaign, problem, *rest = given
    other, parameters = copy(problem), problem.model.parameters
    all_changed = replace(parameters, parameters=tuple(changed(p) for p in parameters.parameters))
    other.model = replace(problem.model, parameters=all_changed)
    return (campaign, other, *rest)


def _prior(quantities: tuple[str, ...], name: str, value: str, source: str, field: str = "prior_sd") -> Constant:
    def change(given: _Arguments, factor: float) -> _Arguments:
        def changed(p: Parameter) -> Parameter:
            return replace(p, **{field: factor * getattr(p, field)}) if p.quantity in quantities else p

        return _with_priors(given, changed)

    return Constant(name, value, source, change)


def _gain(kind: str, name: str) -> Constant:
    def change(given: _Arguments, factor: float) -> _Arguments:
        campaign, problem, *rest = given
        other, model = copy(problem), problem.model
        other.forget()
        units = np.array([factor if s.kind == kind else 1.0 for s in model.layout.sensors])
        other.model = replace(model, arrays=tuple(a._replace(gain_sd=units * a.gain_sd) for a in model.arrays))
        return (campaign, other, *rest)

    return Constant(name, f"{GAIN_SD[kind]:g}", "assumption: no data sheet stands behind it", change, own_data=True)


def constants() -> list[Constant]:
    """All constants of the product that are prior standard deviations or medians of a bump fit."""
    general, guess = "assumption: general knowledge of heavy vehicles", "assumption: data books state no spread"
    lists = "assumption: lists of parts; nobody weighs them"
    weighed = "assumption: portable axle scales err by 0.5 to 1 %"
    return [
        _tolerance("axle_load_factor", "tolerance of a reading of the axle scale", "0.5 %", weighed),
        _tolerance("axle_load_scale_factor", "tolerance of the scale that all readings share", "0.5 %", weighed),
        _tolerance("unsprung_mass_factor", "tolerance of unsprung masses", "8 %", lists),
        _tolerance("pitch_inertia_factor", "tolerance of pitch inertias", "25 %", "assumption: guessed from the shape"),
        _tolerance("cg_height_factor", "tolerance of heights of the centre of gravity", "10 %", "assumption: guessed"),
        _tolerance("hitch_height_factor", "tolerance of the height of the hitch", "3 %", "assumption: tape measure"),
        _prior(("stiffness",), "log sd of k about its drop, or generic", "0.2 to 0.9", general),
        _prior(("damping",), "log sd of c about its drop, or generic", "0.4 to 1", general),
        _prior(("tire_stiffness",), "log sd of tire stiffness", f"{priors.TIRE_STIFFNESS_SD:g}", guess),
        _prior(("tire_damping",), "log sd of tire damping", f"{priors.TIRE_DAMPING_SD:g}", guess),
        _prior(
            ("tire_exponent",),
            "log sd of the exponent of the tire's law of load",
            f"{priors.TIRE_EXPONENT[1]:g} about {priors.TIRE_EXPONENT[0]:g}",
            "1 is linear, 1.5 radial springs; assumption between them",
        ),
        _prior(
            ("jounce_travel", "rebound_travel"), "log sd of travel to the stops", f"{elements.TRAVEL_SD:g}", general
        ),
        _prior(
            ("friction",),
            "median of dry friction, share of the load",
            f"{elements.FRICTION_SHARE['leaf']:g} of leaf packs",
            "2 to 10 % of the load in leaf packs (Fancher et al., UMTRI-86-12)",
            "prior_median",
        ),
        _departure(departures.ENVELOPE, "", "assumption: from one contact law all the way to another"),
        _departure(departures.FOOTPRINT, " in log stiffness", "assumption"),
        _departure(departures.SPOKES, " of the exponent", "assumption"),
        _departure(departures.TIRE_LOAD, " in log stiffness", "assumption: beyond the common exponent"),
        _departure(departures.TIRE_DAMPING, "", "assumption: half way from the contact law to a constant"),
        _departure(departures.FRICTION, " of the load", "2 to 10 % in leaf packs (Fancher et al., UMTRI-86-12)"),
        _departure(departures.BUSHING, " mm/kN", "assumption: eyes of 2 to 20 kN/mm"),
        _departure(departures.BUMP, " of the height", "assumption: rubber gives; a scan misses where it was taken"),
        _departure(departures.TRAILING, " of the jounce", "assumption: a link of 0.6 m that slopes by 60 mm"),
        _gain("suspension_deflection", "sd of the gain of deflection sensors"),
        _gain("axle_acceleration", "sd of the gain of accelerometers on axles"),
        _gain("body_acceleration", "sd of the gain of accelerometers on bodies"),
    ]


def fitted(campaign: Path, output: Path) -> tuple[_Arguments, np.ndarray]:
    """Fit a campaign with default options; what its covariance was computed from, and its sd of log k and c (n,)."""
    given: list[_Arguments] = []

    def kept(*arguments: Any) -> information.AdjustedInformation:
        given.append(arguments)
        return information.adjusted_information(*arguments)

    with patch.object(evaluation, "adjusted_information", kept):
        fit = Calibration(campaign, output).fit()
    if not given:
        raise SystemExit(f"{output} has a finished fit; give a folder that does not exist.")
    return given[-1], np.sqrt(np.diag(fit.covariance))[_k_and_c(given[-1])]


def _k_and_c(given: _Arguments) -> list[int]:
    """Places of k and c among the parameters."""
    parameters = given[1].model.parameters.parameters
    return [i for i, p in enumerate(parameters) if p.quantity in ("stiffness", "damping")]


def solved(given: _Arguments, data: information.BlockInformation) -> Optimum:
    """Optimum and standard deviations of k and c by the normal equations of what the fit was given."""
    _, problem, vector, allowances, amounts, _ = given
    steps: list[np.ndarray] = []

    def kept(*arguments: Any) -> information.ModelError:
        found = real(*arguments)
        steps.append(found.step.parameters)
        return found

    real = information.model_error
    here = np.zeros(allowances.count) if amounts is None else amounts
    with (
        patch.object(information, "optimum_information", lambda *_: data),
        patch.object(information, "model_error", kept),
    ):
        adjusted = information.adjusted_information(given[0], problem, vector, allowances, here, given[5])
    chosen = _k_and_c(given)
    covariance = np.linalg.inv(adjusted.information + adjusted.data.prior)
    log_value = problem.unpack(vector)[0] + steps[-1]
    return Optimum(log_value[chosen], np.sqrt(np.diag(covariance))[chosen])


@contextmanager
def _set(constant: Constant, factor: float) -> Iterator[None]:
    if constant.module is None:
        yield
        return
    with patch.dict(constant.module, {constant.key: factor * constant.module[constant.key]}):
        yield


def effects(given: _Arguments, constant: Constant, data: information.BlockInformation, now: Optimum) -> list[str]:
    """For each factor: largest change of a k and of a c [%], and the median ratio of half-widths."""
    parameters = given[1].model.parameters.parameters
    stiff = np.array([parameters[i].quantity == "stiffness" for i in _k_and_c(given)])
    cells = []
    for factor in FACTORS:
        changed = constant.change(given, factor)
        with _set(constant, factor):
            own = _data(changed) if constant.own_data else data
            then = solved(changed, own)
        moved = 100.0 * np.abs(np.expm1(then.log_value - now.log_value))
        wider = then.sd / now.sd
        cells += [f"{moved[stiff].max():.2f}", f"{moved[~stiff].max():.2f}"]
        cells += [f"{np.median(wider[stiff]):.2f}", f"{np.median(wider[~stiff]):.2f}"]
    return cells


def _data(given: _Arguments) -> information.BlockInformation:
    campaign, problem, vector, allowances, amounts, _ = given
    other = copy(problem)
    other.forget()
    return information.optimum_information(campaign, other, vector, allowances, amounts)


def table(given: _Arguments, sd: np.ndarray) -> str:
    """A row per constant, with what halving and doubling it does; `sd` (n,) are those of the fit."""
    data = _data(given)
    now = solved(given, data)
    if not np.allclose(now.sd, sd, rtol=1e-3):
        raise SystemExit("The equations do not give the standard deviations of the fit; the study has to follow it.")
    lines = [
        "| constant | value | source | k, c moved by 1/2 [%] | half-widths of k, c times | by 2 [%] | times |",
        "|---|---|---|---|---|---|---|",
    ]
    for constant in constants():
        k, c, of_k, of_c, k2, c2, of_k2, of_c2 = effects(given, constant, data, now)
        of = f"{constant.name} | {constant.value} | {constant.source}"
        lines.append(f"| {of} | {k}, {c} | {of_k}, {of_c} | {k2}, {c2} | {of_k2}, {of_c2} |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaign", nargs="+", type=Path, help="campaign files, or their folders")
    parser.add_argument("--output", type=Path, required=True, help="folder for the fits; must not have any")
    parser.add_argument("--document", type=Path, help="page whose tables are replaced, by the names of the campaigns")
    options = parser.parse_args()
    for campaign in options.campaign:
        name = campaign.resolve().name if campaign.is_dir() else campaign.resolve().parent.name
        text = table(*fitted(campaign, options.output / name))
        sys.stdout.write(f"{name}\n\n{text}\n\n")
        if options.document:
            write_between_marks(options.document, name, text)


if __name__ == "__main__":
    main()
