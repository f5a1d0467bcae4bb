"""Verdict and numbers: each sentence appears exactly when its reason is there."""

import math
from dataclasses import replace

import pytest
from small_results import (
    Words,
    before_sampling,
    campaign_only,
    small_balance,
    small_fit,
    small_results,
    with_estimates,
)

from sysid.campaign.findings import QualityReport
from sysid.campaign.records import CampaignDetails
from sysid.estimation.fit.thresholds import MISFIT
from sysid.estimation.parameters.rockers import LoadShare
from sysid.estimation.parameters.undeclared_parts import Drive, UndeclaredFrame
from sysid.estimation.uncertainty.identifiability import UndeterminedGroup
from sysid.estimation.uncertainty.part_agreement import PartDifference
from sysid.numbers import decimals, fixed, interval, listing, number, percent
from sysid.prediction.trust import Extrapolation
from sysid.report.figures import representative_run
from sysid.report.verdict import verdict
from sysid.results.judgement import in_words, judge

FRAME = UndeclaredFrame("trailer", 8.0, 7.9, 8.1)
ROCKER = LoadShare("rocker 1", (0, 1), 0.8, 0.75, 0.85)


def blameless():
    """Results without any reason for a caution."""
    results = small_results()
    axles = tuple(replace(a, jounce_travel_m=0.1, rebound_travel_m=0.1) for a in results.campaign.vehicle.axles)
    campaign = replace(results.campaign, vehicle=replace(results.campaign.vehicle, axles=axles))
    agreement = tuple(replace(c, residual_over_noise=1.0) for c in results.validation.channels)
    good = tuple(replace(c, verdict="good") for c in results.quality.channels)
    passes = tuple(replace(p, trust=(), beyond=None, warnings=()) for p in results.predictions.passes)
    return replace(
        results,
        campaign=campaign,
        predictions=replace(results.predictions, passes=passes),
        validation=replace(results.validation, channels=agreement),
        quality=replace(results.quality, channels=good),
    )


def parts(difference, least_seen, scatter=0.0):
    """One division of the data in which k of axle 1 differs, and one that tells less."""
    known = PartDifference(
        "the slower runs", "the other runs", "k_1", "stiffness", difference, 0.01, least_seen, scatter
    )
    return known, replace(known, part="the deflections", rest="the other sensors", difference=0.0, least_seen=1.0)


def test_nothing_against_it_is_a_yes():
    v = verdict(blameless())
    assert (v.tone, v.answer, v.badge, v.badge_tone) == ("good", "Yes", "CONVERGED", "good")
    assert len(v.use) == 1


def test_no_badge_is_green_beside_an_answer_that_forbids():
    v = verdict(replace(blameless(), fit=replace(small_fit(), impossible=("slip = 7.7 m.",))))
    assert (v.answer, v.badge, v.badge_tone) == ("Do not bet on them", "CONVERGED", "caution")


@pytest.mark.parametrize(
    ("change", "trust", "answer", "forbids"),
    [
        ({}, "use", "Yes", False),
        # As after the stage `fit` alone.
        ({"posterior": None, "status": "not_converged"}, "use_within", "Yes, within limits", False),
        ({"fit": replace(small_fit(), misfit=MISFIT)}, "do_not_bet", "Do not bet on them", True),
        # Parts of the data would show what matters, and do not.
        ({"fit": replace(small_fit(), misfit=MISFIT, parts=parts(0.0, 0.01))}, "use", "Yes", False),
        (
            {"fit": replace(small_fit(), misfit=MISFIT, parts=parts(0.0, 0.03))},
            "do_not_bet",
            "Do not bet on them",
            True,
        ),
        # A difference by chance, one that is accepted, and one that is not.
        ({"fit": replace(small_fit(), parts=parts(0.009, 0.01))}, "use", "Yes", False),
        ({"fit": replace(small_fit(), parts=parts(-0.015, 0.01))}, "use_within", "Yes, within limits", False),
        ({"fit": replace(small_fit(), parts=parts(-0.025, 0.01))}, "do_not_bet", "Do not bet on them", True),
        ({"fit": replace(small_fit(), parts=parts(-0.025, 0.03))}, "use", "Yes", False),
        # Many small differences together.
        ({"fit": replace(small_fit(), parts=parts(0.009, 0.01, 0.015))}, "use_within", "Yes, within limits", False),
        ({"fit": replace(small_fit(), parts=parts(0.009, 0.01, 0.025))}, "do_not_bet", "Do not bet on them", True),
        ({"fit": replace(small_fit(), impossible=("slip = 7.7 m.",))}, "do_not_bet", "Do not bet on them", True),
        # Just below the limit, as it is printed, and where nothing is known.
        ({"fit": replace(small_fit(), misfit=MISFIT - 0.006)}, "use", "Yes", False),
        ({"fit": replace(small_fit(), misfit=math.nan)}, "use", "Yes", False),
        ({"fit": replace(small_fit(), misfit=MISFIT), "status": "not_converged"}, "not_yet", "Not yet", True),
        ({"status": "preview"}, "not_yet", "Not for decisions", True),
    ],
)
def test_one_verdict_of_the_first_screen_and_of_the_files(change, trust, answer, forbids):
    results = with_estimates(replace(blameless(), **change))
    judgement, screen = judge(results), verdict(results)
    assert (judgement.trust, judgement.forbids, screen.answer) == (trust, forbids, answer)
    assert judgement.reasons == screen.use
    assert judgement.notes == screen.notes
    assert len(judgement.kinds) == len(judgement.reasons)
    assert not (judgement.forbids and any("Take k and c" in step for step in screen.todo))


def with_fit(**changes):
    return {"fit": replace(small_fit(), **changes)}


def with_posterior(*, against=(), **changes):
    return {"posterior": replace(small_results().posterior, warnings=(*changes.get("warnings", ()), *against),
                                 against_intervals=against)}  # fmt: skip


def with_groups(*groups):
    return with_fit(identifiability=replace(small_fit().identifiability, groups=groups))


def with_pass_warning(sentence):
    predictions = blameless().predictions
    return {
        "predictions": replace(predictions, passes=tuple(replace(p, warnings=(sentence,)) for p in predictions.passes))
    }


@pytest.mark.parametrize(
    ("change", "trust", "sentence"),
    [
        (with_fit(doubts=("An independent solver ends 3.0 standard deviations away.",)), "use_within", "solver ends 3"),
        (with_posterior(against=("7 of 64 walkers are stuck.",)), "do_not_bet", "walkers are stuck"),
        # Tires are known from elsewhere.
        (with_groups(UndeterminedGroup(("kt_1", "kt_2"), 1, "sum", 0.02)), "use", "converged"),
        ({"quality": QualityReport((), ("x", "Drops are exchanged."), contradictions=("Drops are exchanged.",))},
         "use_within", "Drops are exchanged"),
        # A remark on the data that was dealt with.
        ({"quality": QualityReport((), ("20 rows are missing.",))}, "use", "converged"),
    ],
)  # fmt: skip
def test_what_fit_sampler_and_bookkeeping_warn_of_lowers_the_verdict(change, trust, sentence):
    judgement = judge(with_estimates(replace(blameless(), **change)))
    assert judgement.trust == trust
    (said,) = judgement.reasons
    assert sentence in said


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (with_posterior(warnings=("The posterior fits better than the optimum.",)), "fits better than"),
        (
            with_groups(UndeterminedGroup(("stop_1", "k_1"), 1, "sum", 0.02)),
            "bump stop of axle 1 and k of axle 1",
        ),
        (with_groups(UndeterminedGroup(("stop_1",), 0, "none", math.nan)), "determine the bump stop of axle 1"),
        (with_pass_warning("No run crossed this bump: an extrapolation."), "No run crossed"),
    ],
)
def test_what_says_nothing_against_k_and_c_is_a_note(change, sentence):
    judgement = judge(with_estimates(replace(blameless(), **change)))
    assert judgement.trust == "use"
    (note,) = judgement.notes
    assert sentence in note


def test_a_disagreement_names_value_parts_and_chance():
    found = replace(blameless(), fit=replace(small_fit(), parts=parts(-0.1, 0.03)))
    judgement = judge(with_estimates(found))
    (reason,) = judgement.reasons
    assert judgement.kinds == ("parts_disagree",)
    # exp(-0.1) - 1 = -9.5 %.
    assert "k of axle 1 9.5\u00a0% lower by the slower runs than by the other runs (chance alone: 1.0\u00a0%)" in reason


def test_a_value_that_repeats_its_prior_is_said_once():
    fit = small_fit()
    parameters = tuple(replace(p, identified=p.name != "k_1") for p in fit.parameters)
    groups = (UndeterminedGroup(("k_1",), 0, "none", math.nan),)
    fit = replace(fit, parameters=parameters, identifiability=replace(fit.identifiability, groups=groups))
    judgement = judge(with_estimates(replace(blameless(), fit=fit)))
    assert [s for s in judgement.reasons if "determine" in s] == [
        "The data do not determine k of axle 1: these values repeat the prior."
    ]


def test_least_squares_that_did_not_converge_are_not_sampled_longer():
    screen = verdict(with_estimates(replace(blameless(), fit=small_fit(converged=False), status="not_converged")))
    assert sum("converge" in sentence for sentence in screen.use) == 1
    assert not any("--max-steps" in step for step in screen.todo)
    assert any("Declare the travel" in step for step in screen.todo)


@pytest.mark.parametrize(
    ("change", "tone", "sentence"),
    [
        ({"status": "preview"}, "stop", "preview"),
        ({"status": "not_converged"}, "stop", "has not converged"),
        ({"posterior": None}, "caution", "has not been sampled"),
        ({"fit": None, "posterior": None}, "stop", "starting points"),
        ({"fit": None, "posterior": None, "drops": None}, "stop", "No stage"),
        ({"fit": small_fit(converged=False)}, "stop", "did not converge"),
        ({"fit": replace(small_fit(), undeclared_rockers=(ROCKER,))}, "caution", "Axles 1 and 2 behave as if a rocker"),
        ({"fit": replace(small_fit(), undeclared_frames=(FRAME,))}, "caution", "bends at 8.00 Hz"),
        ({"fit": replace(small_fit(), undeclared_drive=Drive("road", 0.05))}, "caution", "held by its wheels"),
        ({"fit": replace(small_fit(), misfit=MISFIT)}, "stop", "The residuals are 1.3 times the noise"),
        ({"validation": small_results().validation}, "good", "2 of 6 channel records"),
        ({"predictions": small_results().predictions}, "good", "tire deflection of axle 2 and lift-off of axle 2"),
    ],
)
def test_each_reason_against_it_is_said(change, tone, sentence):
    v = verdict(with_estimates(replace(blameless(), **change)))
    assert v.tone == tone
    assert any(sentence in s for s in (*v.use, *v.notes))


def test_values_that_repeat_the_prior_or_are_wide_are_named():
    fit = small_fit()
    parameters = tuple(
        replace(p, identified=False) if p.name == "k_1" else replace(p, sd=0.3 * p.value) if p.name == "c_2" else p
        for p in fit.parameters
    )
    v = verdict(with_estimates(replace(blameless(), fit=replace(fit, parameters=parameters), posterior=None)))
    assert any("do not determine k of axle 1" in s for s in v.use)
    assert any(s.endswith("for c of axle 2.") for s in v.use)
    assert any("identify k of axle 1" in s for s in v.todo)


def test_next_steps_follow_from_what_is_missing():
    assert any("'fit'" in s for s in verdict(campaign_only()).todo)
    assert any("'sample'" in s for s in verdict(before_sampling()).todo)
    assert any("'predict'" in s for s in verdict(small_results(predictions=None)).todo)
    assert any("sensor1_mm of runs/r1.csv" in s for s in verdict(small_results()).todo)
    assert any("axle 2" in s and "engine off" in s for s in verdict(small_results()).todo)


def test_wheel_loads_are_said_and_extrapolations_called_so():
    said = " ".join(verdict(small_results()).what).replace("\xa0", " ")
    assert "48 km/h (empty)" in said
    assert "static one is 3.60, on axle 2 (90 % interval [3.40, 3.80]): an extrapolation" in said
    assert "extrapolation" not in " ".join(verdict(blameless()).what)


def with_axles(**changes):
    """Blameless results with other declarations of both axles."""
    results = blameless()
    axles = tuple(replace(a, **changes) for a in results.campaign.vehicle.axles)
    return replace(results, campaign=replace(results.campaign, vehicle=replace(results.campaign.vehicle, axles=axles)))


def test_undeclared_travel_is_asked_for():
    (step,) = travel_steps(jounce_travel_m=None, rebound_travel_m=None)
    assert "every axle" in step
    assert "bump stops then act there" in step
    assert "assumes" in step


def travel_steps(fit=None, **declared):
    results = with_axles(**declared)
    results = results if fit is None else replace(results, fit=fit)
    return [s for s in verdict(results).todo if "jounce_travel_m" in s]


def test_no_travel_is_asked_for_where_no_stop_is_assumed():
    """A declared law is taken at its word, and stops that the runs have shown need no declaration."""
    nowhere = {"jounce_travel_m": None, "rebound_travel_m": None}
    assert travel_steps(**nowhere, suspension_law="friction") == []
    fit = small_fit()
    stops = tuple(replace(p, law="estimated_bump_stops") if p.axle == 0 else p for p in fit.parameters)
    (step,) = travel_steps(replace(fit, parameters=stops), **nowhere)
    assert "of axle 2: " in step


def test_where_one_travel_is_declared_nothing_is_called_assumed():
    """The other direction has no stop at all: neither the fit nor a prediction assumes one."""
    (step,) = travel_steps(rebound_travel_m=None)
    assert "every axle: in the direction without a travel no bump stop acts" in step
    assert "assume" not in step


def test_what_a_pass_goes_beyond_is_said_once_with_its_axles():
    results = blameless()
    (one,) = results.predictions.passes
    trust = [Extrapolation("speed", i, 13.3, 5.6) for i in (0, 1)]
    trust += [Extrapolation("damper_speed", i, 2.0, 1.0) for i in (0, 1)]
    trust.append(Extrapolation("travel", 0, 0.05, 0.03))
    changed = replace(one, trust=tuple(trust))
    v = verdict(replace(results, predictions=replace(results.predictions, passes=(changed,))))
    assert v.answer == "Yes"
    (said,) = v.notes
    run = results.campaign.bump_runs[0]
    driven = f"{run.load_case} {3.6 * run.nominal_speed_m_s:.0f} km/h"
    assert v.loads.words == f"Yes, as driven ({driven}); else estimates only"
    assert v.loads.sentences.startswith("Loads marked * exceed these runs")
    assert (verdict(results).loads.words, verdict(results).loads.sentences) == ("Yes", "")
    both = replace(results.predictions, passes=(one, changed))
    partly = verdict(replace(results, predictions=both)).loads
    assert (partly.words, partly.sentences[: len(driven) + 10]) == (
        "Yes, but for those marked *",
        f"Driven: {driven}. ",
    )
    preview = replace(results, status="preview", judgement=None, predictions=both)
    assert verdict(preview).loads.words == "Not for decisions"
    assert "(empty, 48\u00a0km/h: speed, suspension travel of axle 1 and damper speed of every axle)" in said
    # The largest load at any speed is at the end of the sweep.
    (step,) = [s for s in v.todo if s.startswith("If axle loads")]
    assert step.startswith("If axle loads matter empty at 48\u00a0km/h and empty at 60\u00a0km/h, drive")


def test_synthetic_campaigns_are_called_so():
    # The key says it, and no word of a title.
    measured = small_results(Words(title="Virtual proving ground", notes="not a synthetic truck"))
    assert not verdict(measured).synthetic
    computed = replace(measured.campaign, details=CampaignDetails(synthetic=True))
    assert verdict(replace(measured, campaign=computed)).synthetic


def test_the_run_shown_first_is_of_middle_speed():
    results = small_results()
    runs = [replace(results.campaign.bump_runs[0], nominal_speed_m_s=v, repeat=1) for v in (9.0, 3.0, 6.0)]
    named = [replace(r, log=replace(r.log, file=f"{r.nominal_speed_m_s}")) for r in runs]
    histories = tuple(replace(results.fit.histories[0], file=r.log.file) for r in named)
    changed = replace(
        results,
        campaign=replace(results.campaign, bump_runs=tuple(named)),
        fit=replace(results.fit, histories=histories),
    )
    assert representative_run(changed).file == "6.0"
    assert representative_run(campaign_only()) is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (416.04, "416"), (11.14, "11.1"), (0.07842, "0.0784"), (0.0, "0"), (-1.7, "−1.70"), (None, "—"),
        (math.nan, "—"), (math.inf, "—"), (3e-4, "3.00×10⁻⁴"), (999.9, "1000"), (2.5e7, "2.50×10⁷"), (9.999, "10.0"),
    ],
)  # fmt: skip
def test_three_significant_digits(value, text):
    assert number(value) == text


def test_value_and_interval_share_one_rounding():
    assert decimals(416.0, 6.0) == 0
    assert decimals(416.0, 1.0) == 1
    assert decimals(11.1, 0.5) == 1
    assert decimals(math.nan) == 3
    assert interval(-0.04, 10.02, 1) == "[0.0, 10.0]"
    assert interval(-0.4, 10.02, 1) == "[−0.4, 10.0]"
    assert interval(math.nan, 1.0, 1) == interval(None, 1.0, 1) == ""
    assert fixed(-0.001, 1) == "0.0"


def test_words_for_fractions_and_lists():
    assert percent(0.0316) == "3.2\xa0%"
    assert listing(["a"]) == "a"
    assert listing(["a", "b", "c"]) == "a, b and c"
    assert listing(list("abcdefgh"), 3) == "a, b, c and 5 more"


def test_a_value_that_is_zero_but_for_rounding_is_shown_as_zero():
    """A damping of 3e-12 kN s/m +- 38 has the places of its interval; alone it has none."""
    places = decimals(3.03e-12, 38.0)
    assert (fixed(3.03e-12, places), interval(0.0, 38.0, places)) == ("0.0", "[0.0, 38.0]")
    assert fixed(3.03e-12, decimals(3.03e-12)) == "0"
    assert decimals(3.03e-4, 38.0) == 6


def test_parameters_are_named_in_words_and_names_of_files_are_left_alone():
    assert in_words("stop_1 and c_2[laden] are known, k_3.") == (
        "the bump stop of axle 1 and c of axle 2 (laden) are known, k of axle 3."
    )
    kept = "runs/k_1.csv, k_1.csv: 'c_2' was left out; lock_1, k_1x and knee_x are no parameters."
    assert in_words(kept) == kept


def test_the_balance_speaks_against_laws_that_it_knows_and_confirms_no_others() -> None:
    """k of axle 1 by the balance is 15 % below that of the fit, five standard deviations of both."""
    fit = small_fit()
    low = replace(small_balance().estimates[0], value=0.85 * 4.2e5, low=0.81 * 4.2e5, high=0.89 * 4.2e5)
    balance = replace(small_balance(), estimates=(low,))
    for law, against in (("friction", True), ("leaf_friction", False)):
        parameters = tuple(replace(p, law=law) for p in fit.parameters)
        results = small_results(fit=replace(fit, parameters=parameters), balance=balance)
        judged = judge(results)
        assert ("balance_disagrees" in judged.kinds) == against
        assert any("k of axle 1 15" in s and "One of both" in s for s in judged.reasons) == against
        assert any("k of axle 1 15" in s and "confirms none" in s for s in judged.notes) != against
    # Nor does it know a drive that the fit has found, or the time of one that is declared.
    friction = tuple(replace(p, law="friction") for p in fit.parameters)
    found = small_results(fit=replace(fit, parameters=friction, undeclared_drive=Drive("road", 0.05)), balance=balance)
    campaign = found.campaign
    declared = replace(campaign, vehicle=replace(campaign.vehicle, driven_at="road"))
    without = replace(found, fit=replace(fit, parameters=friction), campaign=declared)
    for judged in map(judge, (found, without)):
        assert "balance_disagrees" not in judged.kinds
        assert any("laws or parts" in note for note in judged.notes)
    same = judge(small_results(fit=fit, balance=small_balance()))
    assert not any("balance" in s for s in (*same.reasons, *same.notes))
