"""Suspension laws: richer ones are taken where the truck has them, and are not where it is linear."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_campaign import Physics, write_campaign

from sysid.campaign import check_quality, read_campaign
from sysid.campaign.records import BumpRun, Campaign
from sysid.estimation.fit import law_choice, law_comparison
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.law_evidence import Evidence, Judged, LawEvidence
from sysid.estimation.fit.law_screen import candidates, promising
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.search_plan import base, before_joint, first_sight, rough_trial, trial
from sysid.estimation.fit.thresholds import DECISIVE
from sysid.estimation.parameters.campaign_parameters import campaign_parameters, declared_laws
from sysid.estimation.parameters.law_families import richest_laws, without_knees
from sysid.progress import unwatched
from sysid.road import analyse_scan, read_point_cloud
from sysid.sdof.summary import analyse_drops

SMALL = Physics(speeds_km_h=(9.0, 22.0), drops_per_axle=1, scan_points=8000, seed=3, element_spread=0.2)
OPTIONS = FitOptions(weight_rounds=2, second_solver=False, tolerance=1e-5, target_step_s=0.0025)


def read(folder, physics: Physics, inertia: float = 1.0):
    """A campaign whose file says nothing about suspension laws, what its drops say, and its road profiles.

    Pitch inertias are declared as `inertia` times the true ones.
    """
    write_campaign(folder, physics)
    file = folder / "campaign.toml"
    lines = [line for line in file.read_text().splitlines() if not line.startswith("suspension_law")]
    declared = re.sub(
        r"(pitch_inertia_kg_m2 = \[)(.*?)\]",
        lambda m: m[1] + ", ".join(str(inertia * float(v)) for v in m[2].split(",")) + "]",
        "\n".join(lines),
    )
    file.write_text(declared)
    campaign, _ = check_quality(read_campaign(folder, point_cloud_reader=read_point_cloud))
    profiles = {name: analyse_scan(scan).profile for name, scan in campaign.scans.items()}
    return campaign, analyse_drops(campaign), profiles


def fitted(folder, physics: Physics, choice: str, *, spread: bool = False):
    """Fit of a campaign whose file says nothing about suspension laws, and its truth."""
    options = FitOptions(**{**OPTIONS.__dict__, "laws": choice, "contact_spread": spread})
    fit, _ = fit_with_laws(*read(folder, physics), options)
    return fit, tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))["parameters"]


def stub(cost: float, count: int, converged: bool = True) -> SimpleNamespace:
    """An optimum of a given cost, with 100 residuals."""
    weights = SimpleNamespace(tempering=(np.ones((1, 1)),))
    model = SimpleNamespace(groups=(SimpleNamespace(measured=np.ones((100, 1, 1), bool)),))
    problem = SimpleNamespace(count=count, weights=weights, model=model)
    return SimpleNamespace(problem=problem, minimum=SimpleNamespace(cost=cost, converged=converged), misfit=2.0)


def as_it_is(optimum: SimpleNamespace) -> Judged:
    """An optimum whose masses and tires are known."""
    return Judged(optimum, Evidence(optimum.minimum.cost, np.eye(optimum.problem.count), np.zeros(1)))


@pytest.mark.parametrize("converged", [True, False])
def test_poor_laws_are_compared_under_the_maps_of_the_rich_ones(monkeypatch, converged):
    """Their own maps are another problem: the gain is that over the poor laws fitted as every trial."""
    asked, poor_laws, rich_laws = [], (frozenset(),), (frozenset({"friction"}),)
    poor, under_rich_maps, rough, rich = stub(500.0, 4), stub(60.0, 4), stub(51.0, 5), stub(50.0, 5, converged)
    final = stub(49.0, 5)
    promises = [(frozenset({"friction"}),), ()]

    def fitted(laws, near, plan=before_joint):
        asked.append((laws, near, plan))
        return {rough_trial: under_rich_maps, first_sight: rough, base: rich, before_joint: final}[plan]

    monkeypatch.setattr(law_comparison, "_trial", lambda laws, optimum, gain: gain)
    monkeypatch.setattr(law_comparison, "_sure", lambda *rest: True)
    monkeypatch.setattr(law_comparison, "promising", lambda *rest: promises.pop(0))
    monkeypatch.setattr(law_comparison, "LawEvidence", lambda campaign, optimum: SimpleNamespace(judge=as_it_is))
    for name in ("by_trial", "by_score"):
        monkeypatch.setattr(law_comparison, name, lambda *rest: ())
    axle = SimpleNamespace(suspension_law=None, suspension="leaf")
    data = SimpleNamespace(vehicle=SimpleNamespace(axles=(axle,), suspension_axle=(0,)))
    best, comparison = law_comparison.compare_laws(data, poor_laws, rich_laws, poor, fitted)
    again = [] if converged else [(rich_laws, rich, before_joint)]
    assert asked == [
        (rich_laws, poor, first_sight),
        (rich_laws, rough, base),
        (poor_laws, rich, rough_trial),
        *again,
    ]
    assert comparison.trials[0].cost == 60.0
    assert comparison.trials[1] == pytest.approx(20.0 - np.log(100.0))
    # The base stands on its own, unless it ended early.
    assert best is (rich if converged else final)


@pytest.mark.parametrize("sd", [0.03, 2.0])
def test_a_preview_leaves_out_what_is_needless_in_one_fit(monkeypatch, sd):
    """Laws are added as long as more are promised; then friction goes if Wald's test says that nothing is worse.

    By hand: F known to 3 % raises the sum of squares by 1 / 0.03^2 = 1111 when it goes, known to 200 % by 0.25.
    """
    friction, gas = frozenset({"friction"}), frozenset({"gas_spring"})
    asked, promises = [], [(friction,), (gas,), ()]
    found = {(friction,): stub(60.0, 5), (friction | gas,): stub(50.0, 6), (gas,): stub(55.0, 5)}

    def fitted(laws, near, plan=before_joint):
        asked.append((laws, plan))
        return found[laws]

    def judge(optimum):
        known = known_forces([1000.0], sd, np.eye(1))
        known.optimum.problem.model.parameters.parameters.append(SimpleNamespace(quantity="progressivity", axle=0))
        spread = np.diag([sd, 0.01]) ** 2
        return Judged(
            SimpleNamespace(**{**known.optimum.__dict__, "vector": np.log([1000.0, 0.3])}),
            Evidence(50.0, spread, np.zeros(2)),
        )

    monkeypatch.setattr(law_comparison, "promising", lambda *rest: promises.pop(0))
    monkeypatch.setattr(law_comparison, "LawEvidence", lambda campaign, optimum: SimpleNamespace(judge=judge))
    axle = SimpleNamespace(suspension_law=None, suspension="air")
    data = SimpleNamespace(vehicle=SimpleNamespace(axles=(axle,), suspension_axle=(0,)))
    best, comparison = law_comparison.compare_laws(
        data, (frozenset(),), (friction | gas,), stub(500.0, 4), fitted, preview=True
    )
    needless = [] if sd < 1.0 else [((gas,), first_sight)]
    assert asked == [((friction,), first_sight), ((friction | gas,), first_sight), *needless]
    assert best is found[asked[-1][0]]
    assert comparison.chosen == comparison.trials[0].laws == (" + ".join(sorted(asked[-1][0][0])),)
    assert (comparison.untried, comparison.undecided) == (True, ())
    assert np.isnan(comparison.trials[0].gain)


def test_a_preview_chooses_laws_by_one_run_of_each_kind():
    """Of repeats the first with most channels; another load case, bump or speed is another kind."""

    def run(name, load_case, bump, speed, channels):
        log = SimpleNamespace(file=name, channels=(None,) * channels)
        return BumpRun("", load_case, speed, 1, log, bump)

    runs = (
        run("poor", "empty", "a", 5.0, 3), run("rich", "empty", "a", 5.0, 4), run("again", "empty", "a", 5.0, 4),
        run("faster", "empty", "a", 6.0, 1), run("laden", "full", "a", 5.0, 1), run("other", "empty", "b", 5.0, 1),
    )  # fmt: skip
    campaign = Campaign("", "", Path(), Path(), None, {}, None, (), runs, {}, (), {})
    assert [r.log.file for r in law_choice.one_of_each(campaign).bump_runs] == ["rich", "faster", "laden", "other"]


def known_forces(values: list[float], sd: float, spread: np.ndarray) -> Judged:
    """An optimum with friction forces whose logarithms have a covariance with the given factor."""
    quantities = [SimpleNamespace(quantity="friction", axle=i) for i in range(len(values))]
    model = SimpleNamespace(parameters=SimpleNamespace(parameters=quantities))
    optimum = SimpleNamespace(problem=SimpleNamespace(model=model), vector=np.log(values))
    return Judged(optimum, Evidence(0.0, sd**2 * spread @ spread.T, np.zeros(2)))


@pytest.mark.parametrize(("sd", "sure"), [(0.03, True), (0.3, False)])
def test_an_element_that_is_needed_beyond_doubt_is_not_fitted_without(sd, sure):
    """By hand: two forces known to 3 % and independent raise the sum of squares by 2 / 0.03^2 = 2222 when they go."""
    laws, without = (frozenset({"friction"}),) * 2, (frozenset(),) * 2
    judged = known_forces([1000.0, 3000.0], sd, np.eye(2))
    assert law_comparison._sure(judged, laws, without, 1000.0) is sure


def test_forces_that_only_their_sum_is_known_of_are_judged_together():
    """Correlated by -0.999 each alone is known to 50 % only, and both together to a few per cent."""
    spread = np.linalg.cholesky(np.array([[1.0, -0.999], [-0.999, 1.0]]))
    judged = known_forces([1000.0, 1000.0], 0.5, spread)
    laws = (frozenset({"friction"}),) * 2
    assert law_comparison._sure(judged, laws, (frozenset(),) * 2, 1000.0)
    assert not law_comparison._sure(judged, laws, (frozenset(), laws[1]), 1000.0)


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    law = "friction + asymmetric_damper"
    return fitted(tmp_path_factory.mktemp("worn"), Physics(**{**SMALL.__dict__, "suspension_law": law}), "auto")


def test_friction_and_asymmetric_dampers_are_preferred_by_enough(worn):
    fit, _ = worn
    assert fit.laws == ("friction + asymmetric_damper",) * 3
    trials = {t.laws: t for t in fit.law_comparison.trials}
    best, linear = trials[fit.laws], trials[("linear",) * 3]
    assert best.gain > 100 * DECISIVE
    assert linear.misfit > 1.3 > best.misfit
    # Every trial that lacks one of the two somewhere is behind by enough; without what is sure none was made.
    poorer = [t for t in trials.values() if not all("friction" in law and "damper" in law for law in t.laws)]
    assert best.gain - max(t.gain for t in poorer) > DECISIVE


def test_the_preferred_law_finds_stiffness_and_secant_damping(worn):
    fit, truth = worn
    for p in fit.parameters:
        if p.quantity == "stiffness":
            assert p.value == pytest.approx(truth[p.name], rel=0.05)
        if p.quantity == "damping":  # the secant at 0.5 m/s
            assert p.value == pytest.approx(truth[p.name], rel=0.12)


@pytest.fixture(scope="module")
def two_slopes(tmp_path_factory):
    """A campaign of a truck whose dampers have two slopes, and its true parameters."""
    folder = tmp_path_factory.mktemp("two_slopes")
    known = read(folder, replace(SMALL, suspension_law="bilinear_damper"))
    return known, tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))["parameters"]


@pytest.mark.parametrize("preview", [False, True])
def test_dampers_that_do_not_saturate_lose_their_knees(two_slopes, preview):
    """Two slopes in the truth: the laws found say so, and no knee is left undetermined."""
    known, truth = two_slopes
    fit, _ = fit_with_laws(*known, replace(OPTIONS, preview=preview))
    assert fit.laws == ("bilinear_damper",) * 3
    if preview:
        return
    for p in fit.parameters:
        if p.quantity in ("stiffness", "damping", "damper_asymmetry"):
            assert p.value == pytest.approx(truth[p.name], rel=0.012)
    trials = {t.laws: t for t in fit.law_comparison.trials}
    kneed = trials[("asymmetric_damper",) * 3]
    assert kneed.parameters - trials[fit.laws].parameters == 5
    assert kneed.gain < trials[fit.laws].gain


def test_what_a_bilinear_damper_keeps_is_not_lost_with_the_knee():
    """By hand: a tail of 0.25 known to 10 % raises the sum of squares by (1 - 4)^2 / 0.1^2 = 900 when it becomes 1.

    The asymmetry stays, so that it does not count, however well it is known.
    """
    listed = [("damper_asymmetry", 0, 3.0), ("damper_knee", 0, 0.6), ("damper_tail", None, 0.25)]
    quantities = [SimpleNamespace(quantity=quantity, axle=axle) for quantity, axle, _ in listed]
    model = SimpleNamespace(parameters=SimpleNamespace(parameters=quantities))
    vector = np.log([value for *_, value in listed])
    optimum = SimpleNamespace(problem=SimpleNamespace(model=model), vector=vector)
    laws, without = ((frozenset({element}),) for element in ("asymmetric_damper", "bilinear_damper"))
    for sd, sure in ((0.1, True), (1.0, False)):
        judged = Judged(optimum, Evidence(0.0, np.diag([1e-3, 1.0, sd]) ** 2, np.zeros(3)))
        assert law_comparison._sure(judged, laws, without, 1000.0) is sure
        # Without any damper law, the asymmetry is sure.
        assert law_comparison._sure(judged, laws, (frozenset(),), 1000.0)


def test_a_knee_that_is_declared_stays():
    kneed, friction = frozenset({"asymmetric_damper"}), frozenset({"friction"})
    laws = (kneed | friction, kneed, friction)
    found = without_knees(laws, (frozenset(), kneed, frozenset()))
    assert found == (friction | {"bilinear_damper"}, kneed, friction)


def test_only_a_knee_can_be_added_to_a_bilinear_damper():
    """Its asymmetry is a parameter already: moved once more it would change nothing."""
    vehicle = SimpleNamespace(axles=[SimpleNamespace(suspension="leaf")] * 2, suspension_axle=(0, 1))
    poor, rich = (frozenset({"bilinear_damper"}), frozenset()), (frozenset({"asymmetric_damper"}),) * 2
    found = [(c.quantity.quantity, c.axles) for c in candidates(vehicle, poor, rich)]
    assert found == [("damper_asymmetry", (1,)), ("damper_tail", (0, 1))]


def test_inertias_that_are_ten_per_cent_off_promise_no_law(tmp_path, monkeypatch):
    """The laws of the truck are linear; its declared inertias are less than one tolerance off."""
    campaign, drops, profiles = read(tmp_path, SMALL, inertia=1.1)
    declared = declared_laws(campaign)
    parameters = campaign_parameters(campaign, drops, declared)
    optimum = optimise(campaign, parameters, profiles, OPTIONS, unwatched, plan=first_sight)
    rich = richest_laws(campaign.vehicle.axles, declared)
    assert promising(campaign, declared, rich, optimum) == ()
    # Negative control: were the declared masses exact, the same readings would ask for elements.
    monkeypatch.setattr(LawEvidence, "sd", property(lambda self: np.full(self.count, 1e-9)))
    assert promising(campaign, declared, rich, optimum) != ()


def test_laws_are_judged_as_at_the_optimum_where_a_search_ended_early(tmp_path):
    """Stiffnesses 0.3 % off their optimum: masses may not be credited with what they leave over."""
    campaign, drops, profiles = read(tmp_path, SMALL)
    parameters = campaign_parameters(campaign, drops, declared_laws(campaign))
    there = optimise(campaign, parameters, profiles, OPTIONS, unwatched, plan=first_sight)
    shift = np.zeros_like(there.vector)
    shift[[i for i, p in enumerate(parameters.parameters) if p.quantity == "stiffness"]] = 3e-3
    vector = there.vector + shift
    residual = there.problem.compressed(vector).residual
    early = replace(there, vector=vector, minimum=replace(there.minimum, cost=0.5 * float(residual @ residual)))
    evidence = LawEvidence(campaign, there)
    at_optimum, before_it = evidence.judge(there).evidence, evidence.judge(early).evidence
    np.testing.assert_allclose(shift[: len(parameters.names)] + before_it.step, at_optimum.step, atol=4e-4)
    # The cost keeps what the motions of the runs would take off.
    assert at_optimum.cost < before_it.cost < early.minimum.cost


@pytest.mark.parametrize(
    ("misfit", "share", "how", "compared"),
    [(1.31, 0.0, "auto", True), (1.2, 0.011, "auto", True), (1.2, 0.009, "auto", False), (1.0, 0.0, "compare", True)],
)
def test_laws_are_compared_where_they_may_explain_something(misfit, share, how, compared, monkeypatch):
    """`share` of the sum of squares, 2 x 500, is what the best family is expected to explain."""
    poor, rich = (frozenset(),), (frozenset({"friction"}),)
    monkeypatch.setattr(law_choice, "largest_gain", lambda campaign, laws, rich_laws, optimum: 1000.0 * share)
    monkeypatch.setattr(law_choice, "compare_laws", lambda *rest, preview: ("compared", None))
    monkeypatch.setattr(law_choice, "declared_laws", lambda campaign: poor)
    monkeypatch.setattr(law_choice, "richest_laws", lambda axles, declared: rich)
    monkeypatch.setattr(law_choice._Choice, "fitted", lambda self, laws, near: "linear")
    campaign = SimpleNamespace(vehicle=SimpleNamespace(axles=()))
    choice = law_choice._Choice(campaign, None, {}, replace(OPTIONS, laws=how), unwatched)
    linear = SimpleNamespace(misfit=misfit, minimum=SimpleNamespace(cost=500.0))
    assert choice.chosen(linear)[0] == ("compared" if compared else "linear")


@pytest.mark.parametrize(("plan", "near"), [(base, ["poor", "scanned"]), (first_sight, ["poor"]), (trial, ["poor"])])
def test_optima_that_trials_are_compared_with_have_their_stops_and_weights(plan, near, monkeypatch):
    """After a scan has found a stop, the search goes on from there, so that its residuals are weighed again."""
    asked = []

    def optimise(*given, near, **options):
        asked.append(near)
        return SimpleNamespace(number=len(asked))

    monkeypatch.setattr(law_choice, "optimise", optimise)
    monkeypatch.setattr(law_choice, "campaign_parameters", lambda *given: SimpleNamespace(names=()))
    monkeypatch.setattr(law_choice, "with_touched_stops", lambda campaign, optimum, *rest: scanned)
    monkeypatch.setattr(law_choice, "forget_compiled", lambda: None)
    by_name = {
        name: SimpleNamespace(problem=SimpleNamespace(model=SimpleNamespace(parameters=SimpleNamespace(names=()))))
        for name in ("poor", "scanned")
    }
    scanned = by_name["scanned"]
    found = law_choice._Choice(None, None, {}, OPTIONS, unwatched).fitted((), by_name["poor"], plan)
    assert asked == [by_name[name] for name in near]
    assert found.number == len(near)


def test_a_linear_truck_stays_linear(tmp_path):
    fit, truth = fitted(tmp_path, SMALL, "compare", spread=True)
    assert fit.laws == ("linear",) * 3
    assert max(t.gain for t in fit.law_comparison.trials) < DECISIVE
    for p in fit.parameters:
        if p.quantity in ("stiffness", "damping"):
            assert p.value == pytest.approx(truth[p.name], rel=0.03)
    # The logs were made with the footprint map: it explains them, the others do not.
    assert [t.contact for t in fit.contact_trials] == ["footprint", "cams", "point"]
    misfits = [t.misfit for t in fit.contact_trials]
    assert misfits[0] < 1.1 < misfits[1] < misfits[2]
    # Trials are of the vehicle as declared, the result is of one within its tolerances.
    sd = np.array([p.sd / p.value for p in fit.parameters])
    apart = np.log(fit.contact_trials[0].values) - np.log([p.value for p in fit.parameters])
    assert np.abs(apart / sd).max() < 3.0
