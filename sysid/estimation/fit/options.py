"""Settings of the least-squares stage, and of one search in it."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.estimation.residuals.integration_step import TARGET_STEP_S
from sysid.road.contact_laws import ContactLaw


@dataclass(frozen=True)
class Phase:
    """One search for the parameters under given footprint maps.

    - `weight_rounds`: number of re-estimations of the residual scales on the way;
    - `tolerance`: relative change of the cost that ends it, `before_weights` that of rounds before the last one;
    - `max_iterations`: limit per round;
    - `larger_steps`: whether it integrates with larger steps
      (:mod:`sysid.estimation.residuals.larger_steps`): enough to compare optima by.
    """

    weight_rounds: int
    tolerance: float
    max_iterations: int
    larger_steps: bool = False
    before_weights: float = 1e-4


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
    - `contact_spread` repeats the fit with the other contact laws;
    - `preview` chooses laws by one run of each kind, adds elements by their expected gain without trials of fewer, and
      ends after three rounds of masses and tires.
    """

    weight_rounds: int = 3
    max_iterations: int = 40
    second_solver: bool = True
    tolerance: float = 1e-7
    target_step_s: float = TARGET_STEP_S
    laws: str = "auto"
    contact: ContactLaw = "footprint"
    contact_spread: bool = False
    preview: bool = False

    def phase(
        self,
        *,
        weight_rounds: int | None = None,
        tolerance: float = 0.0,
        max_iterations: int | None = None,
        larger_steps: bool = False,
    ) -> Phase:
        """A search with these settings, or a less exact one: at most so many rounds and iterations, no finer end."""
        return Phase(
            self.weight_rounds if weight_rounds is None else min(self.weight_rounds, weight_rounds),
            max(self.tolerance, tolerance),
            self.max_iterations if max_iterations is None else min(self.max_iterations, max_iterations),
            larger_steps,
        )
