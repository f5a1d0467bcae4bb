"""Which parameters a campaign has, where they start, and what their priors say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_truck import AXLES, EMPTY, LADEN, VEHICLE, bump, campaign, empty_run

from sysid.campaign.priors import NamedPrior, PriorOverride
from sysid.campaign.records import PredictionRequest
from sysid.campaign.vehicle_records import AxleGroup, LeafDimensions
from sysid.errors import CampaignError
from sysid.estimation.fit.law_choice import laws_from_names
from sysid.estimation.parameters.axle_laws import axle_laws, stiffness_positions
from sysid.estimation.parameters.campaign_parameters import AIR_LOAD_EXPONENT, best_drop_estimates, campaign_parameters
from sysid.estimation.parameters.checked_priors import check_priors
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet, PriorLink
from sysid.estimation.residuals.bump_model import bump_model
from sysid.sdof.drop_results import DropEstimate, DropSummary

BOTH = [empty_run("a", 5.0), empty_run("b", 5.0, load_case="laden")]


def estimate(axle: int, method: str, stiffness: float, *, usable: bool = True, load_case: str = "empty"):
    return DropEstimate(axle, load_case, None, method, stiffness, 1e4, 9e3, 5e2, 0.7, 0.5, usable)


def summary(*pooled: DropEstimate) -> DropSummary:
    return DropSummary((), tuple(pooled))


def test_one_load_case_shares_everything():
    found = campaign_parameters(campaign([empty_run("a", 5.0)]), None)
    assert found.names == (
        *("k_1", "k_2", "k_3", "c_1", "c_2", "c_3", "kt_1", "kt_2", "kt_3", "ct_1", "ct_2", "ct_3"),
        found.names[-1],
    )
    assert found.links == ()


def test_air_springs_have_one_stiffness_per_load_case_linked_by_their_load():
    found = campaign_parameters(campaign(BOTH, load_cases=(EMPTY, LADEN)), None)
    assert found.names[:5] == ("k_1", "k_2[empty]", "k_2[laden]", "k_3[empty]", "k_3[laden]")
    link = found.links[0]
    carried = [c.axle_loads_kg[1] - AXLES[1].unsprung_mass_kg for c in (EMPTY, LADEN)]
    assert (link.first, link.second) == ("k_2[empty]", "k_2[laden]")
    assert link.mean == pytest.approx(0.7 * np.log(carried[1] / carried[0]))
    # An exponent of 0.7 +- 0.35: that of constant pressure, 0, lies two standard deviations off.
    assert link.sd == pytest.approx(0.35 * np.log(carried[1] / carried[0]))
    ratio = found.parameters[2].start / found.parameters[1].start
    assert np.log(ratio) == pytest.approx(link.mean)


def test_an_axle_with_a_declared_travel_has_stops_whatever_its_law():
    axles = (
        replace(AXLES[0], jounce_travel_m=0.08),
        replace(AXLES[1], rebound_travel_m=0.1, suspension_law="friction"),
    )
    data = campaign([empty_run("a", 5.0)], vehicle=replace(VEHICLE, axles=(*axles, AXLES[2])))
    found = campaign_parameters(data, None)
    assert [p.name for p in found.parameters if p.quantity == "stop_stiffness"] == ["stop_1", "stop_2"]
    assert [p.law for p in found.parameters[:3]] == ["bump_stops", "friction + bump_stops", "linear"]


def test_friction_grows_with_the_load_that_a_suspension_carries():
    """The laden pass's force over the empty one's is the ratio of the loads on the springs."""
    axles = tuple(replace(a, suspension_law="friction") for a in AXLES)
    data = campaign(BOTH, load_cases=(EMPTY, LADEN), vehicle=replace(VEHICLE, axles=axles))
    parameters = campaign_parameters(data, None)
    model = bump_model(data, parameters, {"bump": bump()})
    cases = [p.load_case for p in model.passes[0]]
    law, _ = axle_laws(model.arrays[0].laws, parameters.start[:, None])
    force = {case: np.asarray(law.friction)[number, :, 0] for number, case in enumerate(cases)}
    unsprung = np.array([a.unsprung_mass_kg for a in AXLES])
    carried = {c.name: np.array(c.axle_loads_kg) - unsprung for c in (EMPTY, LADEN)}
    np.testing.assert_allclose(force["laden"] / force["empty"], carried["laden"] / carried["empty"], rtol=1e-9)
    values = [p.prior_median for p in parameters.parameters if p.quantity == "friction"]
    np.testing.assert_allclose(force["empty"], values, rtol=1e-9)


def test_a_load_case_that_is_only_predicted_has_a_linked_stiffness():
    half = replace(EMPTY, name="half", axle_loads_kg=(4600.0, 5600.0, 5000.0), sprung_mass_kg=(12940.0,))
    request = PredictionRequest("half", 10.0)
    found = campaign_parameters(campaign(BOTH, load_cases=(EMPTY, half, LADEN), predictions=[request]), None)
    assert found.names[:4] == ("k_1", "k_2[empty]", "k_2[half]", "k_2[laden]")
    np.testing.assert_array_equal(stiffness_positions(found, 3, ["half"]), [[0, 2, 5]])


def test_drops_of_the_first_load_case_are_carried_over_to_the_driven_ones():
    """No run was driven empty: its drop still says how stiff the laden air spring must be."""
    half = replace(EMPTY, name="half", axle_loads_kg=(4600.0, 5600.0, 5000.0), sprung_mass_kg=(12940.0,))
    runs = [empty_run("a", 5.0, load_case="half"), empty_run("b", 5.0, load_case="laden")]
    found = campaign_parameters(campaign(runs, load_cases=(EMPTY, half, LADEN)), summary(estimate(1, "paper", 4e5)))
    carried = [c.axle_loads_kg[1] - AXLES[1].unsprung_mass_kg for c in (EMPTY, half, LADEN)]
    assert found.names[1:3] == ("k_2[half]", "k_2[laden]")
    assert found.parameters[1].start == pytest.approx(4e5 * (carried[1] / carried[0]) ** 0.7)
    assert found.parameters[2].start == pytest.approx(4e5 * (carried[2] / carried[0]) ** 0.7)
    assert found.links[0].mean == pytest.approx(0.7 * np.log(carried[2] / carried[1]))
    alone = campaign_parameters(campaign(runs[1:], load_cases=(EMPTY, LADEN)), summary(estimate(1, "paper", 4e5)))
    (spring,) = [p for p in alone.parameters if p.quantity == "stiffness" and p.axle == 1]
    assert (spring.name, spring.load_case, alone.links) == ("k_2", "laden", ())
    assert spring.start == spring.prior_median == pytest.approx(4e5 * (carried[2] / carried[0]) ** 0.7)
    # How much stiffer is uncertain too.
    driven_empty = campaign([empty_run("a", 5.0)], load_cases=(EMPTY, LADEN))
    first = campaign_parameters(driven_empty, summary(estimate(1, "paper", 4e5)))
    (of_empty,) = [p for p in first.parameters if p.quantity == "stiffness" and p.axle == 1]
    assert (of_empty.name, of_empty.load_case, of_empty.start) == ("k_2", "empty", pytest.approx(4e5))
    exponent_sd = AIR_LOAD_EXPONENT[1] * np.log(carried[2] / carried[0])
    assert spring.prior_sd == pytest.approx(np.hypot(of_empty.prior_sd, exponent_sd), rel=1e-12)
    with pytest.raises(KeyError):
        first.index("stiffness", 1, "laden")


def test_index_finds_shared_and_load_dependent_stiffness():
    found = campaign_parameters(campaign(BOTH, load_cases=(EMPTY, LADEN)), None)
    index = stiffness_positions(found, 3, ["laden", "empty", "laden"])
    np.testing.assert_array_equal(index, [[0, 2, 4], [0, 1, 3], [0, 2, 4]])
    assert [found.index("damping", i) for i in range(3)] == [5, 6, 7]
    with pytest.raises(KeyError):
        found.index("friction", 0)


def test_prior_rows_are_the_log_density_of_lognormal_priors_and_links():
    parameters = ParameterSet(
        (
            Parameter("a", "stiffness", "N/m", 1.0, 2.0, 0.5, axle=0),
            Parameter("b", "stiffness", "N/m", 3.0, 4.0, 0.2, axle=1),
        ),
        (PriorLink("a", "b", 0.3, 0.1),),
    )
    rows, targets = parameters.prior_rows()
    x = np.array([0.4, 1.7])
    # The second of a linked pair has no prior of its own: the link would otherwise count twice.
    squares = ((x[0] - np.log(2)) / 0.5) ** 2 + ((x[1] - x[0] - 0.3) / 0.1) ** 2
    assert ((rows @ x - targets) ** 2).sum() == pytest.approx(squares)
    pull, precision = parameters.prior_pull(x)
    of_link = (x[1] - x[0] - 0.3) / 0.1**2
    np.testing.assert_allclose(pull, [(x[0] - np.log(2)) / 0.5**2 - of_link, of_link], rtol=1e-13)
    np.testing.assert_allclose(precision, [[0.5**-2 + 0.1**-2, -(0.1**-2)], [-(0.1**-2), 0.1**-2]], rtol=1e-13)
    np.testing.assert_allclose(parameters.start, np.log([1.0, 3.0]))


def test_the_joint_prior_has_the_marginals_that_the_parameters_state():
    found = campaign_parameters(campaign(BOTH, load_cases=(EMPTY, LADEN)), None)
    rows, targets = found.prior_rows()
    covariance = np.linalg.inv(rows.T @ rows)
    median = np.exp(covariance @ rows.T @ targets)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [p.prior_sd for p in found.parameters], rtol=1e-9)
    np.testing.assert_allclose(median, [p.prior_median for p in found.parameters], rtol=1e-9)


def test_drops_give_start_and_prior_of_their_axle():
    drops = summary(estimate(0, "paper", 3e5), estimate(0, "free_decay", 5e5), estimate(2, "corrected", 4e5))
    chosen = best_drop_estimates(drops, "empty")
    assert {k: v.method for k, v in chosen.items()} == {0: "free_decay", 2: "corrected"}
    found = campaign_parameters(campaign([empty_run("a", 5.0)]), drops)
    assert found.parameters[0].start == pytest.approx(5e5)
    assert found.parameters[2].prior_median == pytest.approx(4e5)
    without = campaign_parameters(campaign([empty_run("a", 5.0)]), None)
    assert found.parameters[1] == without.parameters[1]
    assert found.parameters[0].prior_sd < without.parameters[0].prior_sd


def test_damping_of_drops_that_linear_laws_do_not_explain_is_no_prior():
    """It holds friction, ten times the viscous part and more; the stiffness stays, as wide as the drop says."""
    clear = replace(estimate(0, "model", 5e5), damping=6e4, damping_sd=6e3, stiffness_sd=1e4)
    doubtful = replace(clear, damping_sd=6.1e4, stiffness_sd=2.25e5)
    sure, unsure, without = (
        campaign_parameters(campaign([empty_run("a", 5.0)]), drops).parameters
        for drops in (summary(clear), summary(doubtful), None)
    )
    c = [p.name for p in sure].index("c_1")
    assert (sure[c].prior_median, sure[c].prior_sd) == (pytest.approx(5.94e4, rel=1e-2), 0.4)
    assert unsure[c] == without[c]
    assert (sure[0].prior_sd, unsure[0].prior_sd) == (0.2, pytest.approx(0.45))
    assert unsure[0].prior_median == pytest.approx(5e5)


def test_unusable_drops_and_other_load_cases_are_left_out():
    drops = summary(estimate(0, "free_decay", 5e5, usable=False), estimate(1, "paper", 3e5, load_case="laden"))
    assert best_drop_estimates(drops, "empty") == {}
    assert best_drop_estimates(None, "empty") == {}
    assert best_drop_estimates(summary(estimate(0, "paper", float("nan"))), "empty") == {}


def test_a_drop_that_read_the_wheel_hop_is_pulled_back():
    found = campaign_parameters(campaign([empty_run("a", 5.0)]), summary(estimate(0, "paper", 3e7)))
    assert found.parameters[0].start < 6e6


def test_a_user_s_prior_wins():
    axle = replace(
        AXLES[0], priors={"stiffness": PriorOverride(2.5e5, 0.05), "tire_stiffness": PriorOverride(1e6, 0.2)}
    )
    vehicle = replace(VEHICLE, axles=(axle, *AXLES[1:]))
    found = campaign_parameters(campaign([empty_run("a", 5.0)], vehicle=vehicle), summary(estimate(0, "paper", 5e5)))
    assert (found.parameters[0].prior_median, found.parameters[0].prior_sd) == (2.5e5, 0.05)
    assert (found.parameters[6].prior_median, found.parameters[6].prior_sd) == (1e6, 0.2)


def test_an_unknown_law_is_refused_with_those_that_exist():
    vehicle = replace(VEHICLE, axles=(replace(AXLES[0], suspension_law="rubber"), *AXLES[1:]))
    with pytest.raises(CampaignError, match=r"'steer' asks for suspension_law = 'rubber'.*linear"):
        campaign_parameters(campaign([empty_run("a", 5.0)], vehicle=vehicle), None)


@pytest.mark.parametrize("field", ["start", "prior_median", "prior_sd"])
def test_parameters_are_positive(field: str):
    with pytest.raises(ValueError, match="positive"):
        replace(Parameter("a", "stiffness", "N/m", 1.0, 2.0, 0.5), **{field: 0.0})


def test_an_axle_group_has_one_suspension_named_after_its_first_axle():
    grouped = replace(VEHICLE, groups=(AxleGroup("bogie", (1, 2), 300.0, 90.0),))
    cases = tuple(replace(c, sprung_mass_kg=(c.sprung_mass_kg[0] - 300.0,)) for c in (EMPTY, LADEN))
    data = campaign(BOTH, load_cases=cases, vehicle=grouped)
    drops = summary(estimate(1, "paper", 4e5), estimate(2, "paper", 3e5))
    found = campaign_parameters(data, drops)
    assert found.names == (
        *("k_1", "k_2[empty]", "k_2[laden]", "c_1", "c_2"),
        *("kt_1", "kt_2", "kt_3", "ct_1", "ct_2", "ct_3", "tire_exponent"),
    )
    by_name = {p.name: p for p in found.parameters}
    # As stiff as both axles' drops together, and as the load on both asks for.
    assert by_name["k_2[empty]"].start == pytest.approx(7e5)
    carried = [sum(c.axle_loads_kg[1:]) - 980.0 - 760.0 - 300.0 for c in cases]
    assert found.links[0].mean == pytest.approx(0.7 * np.log(carried[1] / carried[0]))
    assert by_name["c_2"].start == pytest.approx(2 * 9e3)
    # The full model has one estimate for the group, and a leaf pack is the group's.
    model = summary(estimate(1, "paper", 4e5), estimate(2, "paper", 3e5), estimate(1, "model", 6.6e5))
    assert campaign_parameters(data, model).parameters[1].start == pytest.approx(6.6e5)
    pack = LeafDimensions(10, 0.08, 0.013, 1.2)
    axles = tuple(replace(a, suspension="leaf", leaf=pack, load_dependent=False) for a in grouped.axles)
    for vehicle in (replace(grouped, axles=axles, groups=()), replace(grouped, axles=axles)):
        case = (EMPTY,) if not vehicle.groups else cases
        leaf = campaign_parameters(campaign([empty_run("a", 5.0)], load_cases=case, vehicle=vehicle), None)
        assert leaf.parameters[1].prior_median == pytest.approx(leaf.parameters[0].prior_median)
    generic = {p.name: p.start for p in campaign_parameters(data, None).parameters}
    assert generic["k_2[empty]"] == pytest.approx(2 * 3.5e5)
    # The laws that a fit reports, one per suspension, are those of all axles again.
    laws = (frozenset({"friction"}), frozenset({"gas_spring"}), frozenset({"gas_spring"}))
    names = [p.law for p in campaign_parameters(data, drops, laws).parameters if p.quantity == "damping"]
    assert laws_from_names(grouped, names) == laws
    # Every axle of the group finds the group's suspension, and its own tire.
    np.testing.assert_array_equal(stiffness_positions(found, 3, ["empty", "laden"]), [[0, 1, 1], [0, 2, 2]])
    assert [found.index("damping", i) for i in range(3)] == [3, 4, 4]
    assert [found.index("tire_stiffness", i) for i in range(3)] == [5, 6, 7]


def with_priors(vehicle=VEHICLE, **priors: NamedPrior):
    data = campaign(BOTH, load_cases=(EMPTY, LADEN), vehicle=vehicle)
    return replace(
        data, priors={name.replace("__", "[") + ("]" if "__" in name else ""): p for name, p in priors.items()}
    )


def test_a_named_prior_replaces_every_other():
    found = campaign_parameters(with_priors(c_1=NamedPrior(2.2e4, 0.1, "N s/m")), summary(estimate(0, "paper", 5e5)))
    p = found.parameters[found.index("damping", 0)]
    assert (p.start, p.prior_median, p.prior_sd) == (2.2e4, 2.2e4, 0.1)
    rows, targets = found.prior_rows()
    at = found.index("damping", 0)
    (row,) = np.flatnonzero(rows[:, at])
    assert rows[row, at] == pytest.approx(10.0)
    assert targets[row] == pytest.approx(10.0 * np.log(2.2e4))


def test_what_is_linked_to_a_named_prior_follows_it():
    found = campaign_parameters(with_priors(k_2__empty=NamedPrior(3e5, 0.2, "N/m")), None)
    (link,) = [link for link in found.links if link.second == "k_2[laden]"]
    second = found.parameters[2]
    assert second.prior_median == pytest.approx(3e5 * np.exp(link.mean))
    assert second.prior_sd == pytest.approx(np.hypot(0.2, link.sd))
    # The marginal prior that these rows mean, by inverting their precision.
    rows, targets = found.prior_rows()
    covariance = np.linalg.inv(rows.T @ rows)
    assert np.sqrt(covariance[2, 2]) == pytest.approx(second.prior_sd)
    assert (covariance @ rows.T @ targets)[2] == pytest.approx(np.log(second.prior_median))


def test_a_named_prior_of_a_linked_parameter_cuts_the_link():
    found = campaign_parameters(with_priors(k_2__laden=NamedPrior(9e5, 0.1, "N/m")), None)
    assert [link.second for link in found.links] == ["k_3[laden]"]
    rows, _ = found.prior_rows()
    assert np.linalg.inv(rows.T @ rows)[2, 2] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("priors", "said"),
    [
        ({"k_7": NamedPrior(9e5, 0.1, "N/m")}, "[priors] k_7 is not a parameter of this vehicle; did you mean"),
        ({"k_2": NamedPrior(9e5, 0.1, "N/m")}, "give k_2[empty] and k_2[laden]."),
        ({"c_1": NamedPrior(9e3, 0.1, "N/m")}, "is given in N/m, but its unit is N s/m; give median_N_s_per_m or"),
        ({"tire_exponent": NamedPrior(1.2, 0.1, "N/m")}, "its unit is 1; give median or interval90."),
    ],
)
def test_a_named_prior_that_fits_nothing_is_refused(priors, said):
    with pytest.raises(CampaignError) as error:
        check_priors(with_priors(**priors))
    assert said in str(error.value)


def test_named_priors_of_laws_that_may_be_tried_are_welcome():
    check_priors(with_priors(F_1=NamedPrior(800.0, 0.5, "N")))
    axles = (replace(AXLES[0], priors={"damping": PriorOverride(1e4, 0.3)}), *AXLES[1:])
    twice = with_priors(replace(VEHICLE, axles=axles), c_1=NamedPrior(1e4, 0.1, "N s/m"))
    with pytest.raises(CampaignError, match="given twice"):
        check_priors(twice)
