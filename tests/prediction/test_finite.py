"""Predictions that are not numbers are errors with their likely cause, never results."""

from __future__ import annotations

import numpy as np
import pytest
from rigid_truck import VEHICLE, bump, campaign, empty_run, true_log_parameters

from sysid.campaign.records import PredictionRequest
from sysid.errors import CampaignError, DataRejectedError
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.prediction import predict_passes
from sysid.prediction.finite import check_finite
from sysid.prediction.predict_passes import peak_ratios, predict_pass, speed_sweep
from sysid.vehicle_model.passes import EffectiveRoads

REQUEST = PredictionRequest("empty", 10.0)
DATA = campaign([empty_run("a.csv", 9.0)], predictions=[REQUEST])
PARAMETERS = campaign_parameters(DATA, None)
TRUTH = true_log_parameters(PARAMETERS.names)
ROADS = EffectiveRoads(VEHICLE, DATA.load_cases, {"bump": bump()})
DAMPING = PARAMETERS.names.index("c_2")


def changed(value: float) -> np.ndarray:
    sets = TRUTH.copy()
    sets[DAMPING] = value
    return sets


@pytest.mark.parametrize("value", [np.log(1e300), 800.0, np.nan])
def test_a_point_estimate_without_finite_loads_is_an_error(value: float) -> None:
    with pytest.raises(DataRejectedError) as error:
        predict_pass(DATA, PARAMETERS, ROADS, REQUEST, changed(value)[None])
    text = str(error.value)
    assert text.startswith("The pass of load case 'empty' at 36 km/h gives no finite axle loads")
    assert "c_2" in text
    assert "\n" not in text
    assert error.value.exit_code == 3


def test_bad_draws_are_counted_and_the_sweep_is_checked_too() -> None:
    draws = np.stack([TRUTH, changed(np.log(1e300)), TRUTH])
    with pytest.raises(DataRejectedError, match="1 of 3 parameter sets; likely cause: c_2 = 1e"):
        predict_pass(DATA, PARAMETERS, ROADS, REQUEST, draws)
    with pytest.raises(DataRejectedError, match="1 of 3 parameter sets"):
        peak_ratios(DATA, PARAMETERS, ROADS, REQUEST, draws)
    with pytest.raises(DataRejectedError, match="1 of 3 parameter sets"):
        speed_sweep(DATA, PARAMETERS, "empty", "bump", ROADS, draws.T, [10.0])


def test_finite_loads_pass_and_an_axle_without_load_does_not() -> None:
    history = np.zeros((4, 3, 2))
    sets = np.stack([TRUTH, TRUTH], axis=1)
    check_finite(REQUEST, PARAMETERS, sets, np.ones(3), history)
    with pytest.raises(DataRejectedError, match="axle 2 carries no load"):
        check_finite(REQUEST, PARAMETERS, sets, np.array([1.0, 0.0, 1.0]), history)
    history[2, 1, 1] = np.inf
    with pytest.raises(DataRejectedError, match="1 of 2 parameter sets"):
        check_finite(REQUEST, PARAMETERS, sets, np.ones(3), history, np.zeros((4, 3, 2)))
    # Both signs of infinity have no sum.
    history[1, 0, 0] = -np.inf
    with pytest.raises(DataRejectedError, match="2 of 2 parameter sets"):
        check_finite(REQUEST, PARAMETERS, sets, np.ones(3), history)


def test_finite_values_whose_sum_is_too_large_are_finite() -> None:
    check_finite(REQUEST, PARAMETERS, TRUTH[:, None], np.ones(3), np.full((4, 3, 1), 1e308))


@pytest.mark.parametrize("speed", [1e-9, 1e-3])
def test_a_pass_without_end_is_refused_before_memory_is_taken(speed: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(predict_passes, "Timing", None)  # nothing is simulated
    with pytest.raises(CampaignError, match=r"at most 300 s are predicted; choose a higher speed"):
        predict_pass(DATA, PARAMETERS, ROADS, PredictionRequest("empty", speed / 3.6), TRUTH[None])
