"""Static equilibrium against the independently computed values of the multibody model and against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plain_axles import axle

from sysid.campaign import AxleGroup, Body, LoadCase, Vehicle, check_statics, read_campaign, static_equilibrium
from sysid.errors import CampaignError

# What the multibody model behind the linear truck was built with: centres of gravity [m], fifth-wheel load [N],
# suspension preloads [N], 9.81 m/s2.
TRUTH = {
    "unloaded": (
        [1.719772683, 12.82917773],
        18639.0,
        [33501.15, 15951.06, 19247.22, 22376.61, 26555.67, 31450.86],
    ),
    "loaded": (
        [1.719192632, 11.13053367],
        165789.0,
        [42840.27, 84856.5, 88152.66, 103103.1, 105261.3, 107458.74],
    ),
}


@pytest.fixture(scope="module")
def campaign(linear_truck_folder):
    return read_campaign(linear_truck_folder)


@pytest.mark.parametrize("name", TRUTH)
def test_linear_truck_vehicle(campaign, name):
    cg_x, hitch, preload = TRUTH[name]
    statics = static_equilibrium(campaign.vehicle, campaign.load_cases[name])
    assert statics.cg_x_m == pytest.approx(cg_x, rel=1e-8)
    assert statics.hitch_load_N == pytest.approx([0.0, hitch], rel=1e-9)
    assert statics.suspension_preload_N == pytest.approx(preload, rel=1e-9)
    loads = np.array(campaign.load_cases[name].axle_loads_kg)
    assert statics.tire_load_N == pytest.approx(loads * 9.81, rel=1e-12)
    assert statics.tributary_mass_kg == pytest.approx(np.array(preload) / 9.81, rel=1e-9)


def test_three_hinged_bodies_balance_about_every_hinge():
    """Truck, dolly and trailer: each body separately is in balance of forces and moments."""
    vehicle = Vehicle(
        "train",
        (Body("truck"), Body("dolly", 7.0, 1.0), Body("trailer", 9.5, 1.2)),
        (axle("a", 0, 0.0), axle("b", 0, 5.0), axle("c", 1, 9.6), axle("d", 2, 15.0), axle("e", 2, 16.5)),
        gravity_m_s2=9.8,
    )
    loads = np.array([5000.0, 9000.0, 6500.0, 6000.0, 6200.0])
    sprung = np.array([12800.0, 1200.0, 16200.0])
    case = LoadCase("full", tuple(loads), tuple(sprung), (1e4,) * 3, (1.0,) * 3)
    s = static_equilibrium(vehicle, case)
    support = (loads - 500.0) * 9.8
    x = np.array([0.0, 5.0, 9.6, 15.0, 16.5])
    weight = sprung * 9.8
    # Trailer, dolly, truck; moments about the foremost axle.
    assert support[3:].sum() + s.hitch_load_N[2] == pytest.approx(weight[2])
    assert support[3:] @ x[3:] + s.hitch_load_N[2] * 9.5 == pytest.approx(weight[2] * s.cg_x_m[2])
    assert support[2] + s.hitch_load_N[1] == pytest.approx(weight[1] + s.hitch_load_N[2])
    assert support[2] * 9.6 + s.hitch_load_N[1] * 7.0 == pytest.approx(
        weight[1] * s.cg_x_m[1] + s.hitch_load_N[2] * 9.5
    )
    assert support[:2].sum() == pytest.approx(weight[0] + s.hitch_load_N[1])
    assert support[:2] @ x[:2] == pytest.approx(weight[0] * s.cg_x_m[0] + s.hitch_load_N[1] * 7.0)


def test_uncoupled_bodies_are_checked_one_by_one():
    vehicle = Vehicle("pair", (Body("one"), Body("two")), (axle("a", 0, 0.0), axle("b", 1, 3.0), axle("c", 1, 5.0)))
    case = LoadCase("x", (2000.0, 1500.0, 2500.0), (1500.0, 3000.0), (1.0, 1.0), (1.0, 1.0))
    s = static_equilibrium(vehicle, case)
    assert s.cg_x_m == pytest.approx([0.0, (1000.0 * 3.0 + 2000.0 * 5.0) / 3000.0])
    assert s.hitch_load_N.tolist() == [0.0, 0.0]
    # The total agrees, the parts do not: moving 100 kg from one body to the other is an error of each.
    with pytest.raises(CampaignError, match=r"under one sum to 2000 kg.*difference of -100 kg"):
        check_statics(vehicle, replace(case, sprung_mass_kg=(1600.0, 2900.0)))


def test_group_beam_hangs_on_its_axles():
    vehicle = Vehicle(
        "bogie", (Body("frame"),), (axle("a", 0, 0.0), axle("b", 0, 4.0)), groups=(AxleGroup("g", (0, 1), 300.0, 50.0),)
    )
    case = LoadCase("x", (2000.0, 3000.0), (3700.0,), (1.0,), (1.0,))
    s = static_equilibrium(vehicle, case)
    assert s.tributary_mass_kg == pytest.approx([1350.0, 2350.0])


def test_scale_tolerance(campaign):
    """0.4 % of the 20,057 kg on the scales passes and leaves the axle loads exact, 0.6 % is an error that names kg."""
    case = campaign.load_cases["unloaded"]
    near = replace(case, sprung_mass_kg=(5103.0 + 80.0, 10094.0))
    s = static_equilibrium(campaign.vehicle, near)
    assert s.suspension_preload_N == pytest.approx(TRUTH["unloaded"][2], rel=1e-9)
    assert s.hitch_load_N[1] == pytest.approx(18639.0)
    with pytest.raises(CampaignError, match=r"'unloaded'.*20057 kg.*20177 kg.*-120 kg") as error:
        check_statics(campaign.vehicle, replace(case, sprung_mass_kg=(5223.0, 10094.0)))
    assert "\n" not in str(error.value)


def test_axle_load_below_the_unsprung_mass(campaign):
    case = replace(campaign.load_cases["unloaded"], axle_loads_kg=(500.0, 2676.0, 3012.0, 3021.0, 3447.0, 3946.0))
    with pytest.raises(CampaignError, match=r"'front steer' \(500 kg\).*540 kg"):
        check_statics(campaign.vehicle, case)


def test_swapped_sprung_masses_are_noticed(campaign):
    case = replace(campaign.load_cases["loaded"], sprung_mass_kg=(49094.0, 5103.0))
    with pytest.raises(CampaignError, match="centre of gravity"):
        check_statics(campaign.vehicle, case)


def test_body_without_support():
    vehicle = Vehicle("x", (Body("one"), Body("two")), (axle("a", 0, 0.0),))
    with pytest.raises(CampaignError, match="'two' has neither an axle nor a hinge"):
        check_statics(vehicle, LoadCase("x", (2000.0,), (1500.0, 1.0), (1.0, 1.0), (1.0, 1.0)))
