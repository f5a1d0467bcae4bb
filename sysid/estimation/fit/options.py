"""Settings of the least-squares stage."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.estimation.residuals.bump_model import TARGET_STEP_S
from sysid.road.contact_laws import ContactLaw


@dataclass(frozen=True)
class FitOptions:
    """Settings of the least-squares stage.

    - `weight_rounds`: number of re-estimations of the residual scales;
    - `max_iterations`: limit per round;
    - `second_solver` searches once more by SciPy's trust-region solver, a tenth of the way back to the start values;
    - `tolerance`: relative change of the cost that ends a round;
    - `target_step_s`: the largest integration step [s];
    - `laws` says how the suspension laws of axles without a declared one are found: ``auto`` compares richer laws where
      linear ones leave residuals that those may explain, ``compare`` always, ``declared`` never
      (:mod:`sysid.estimation.fit.law_choice`);
    - `contact` is the tires' contact law (:mod:`sysid.road.contact_laws`);
    - `contact_spread` repeats the fit with the other contact laws.
    """

    weight_rounds: int = 3
    max_iterations: int = 40
    second_solver: bool = True
    tolerance: float = 1e-7
    target_step_s: float = TARGET_STEP_S
    laws: str = "auto"
    contact: ContactLaw = "footprint"
    contact_spread: bool = False
