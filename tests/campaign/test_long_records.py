"""Long records are cut to the passage, on the same stamps; others stay as they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.campaign import read_campaign
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.passage.cut import cut_to_passages
from sysid.campaign.records import BumpRun, Campaign
from sysid.workflow.inputs import Inputs

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    whole = read_campaign(DATA)
    return replace(whole, bump_runs=whole.bump_runs[:2])


def longer(run: BumpRun, before_s: float, after_s: float) -> BumpRun:
    """The run with noise of the instruments before and after it."""
    random = np.random.default_rng(5)
    step = run.log.sample_interval_s
    ahead, behind = round(before_s / step), round(after_s / step)
    channels = []
    clocks: dict[int, np.ndarray] = {}
    for c in run.log.channels:
        count = c.time_s.size
        value = np.concatenate([np.full(ahead, np.nan), c.value, np.full(behind, np.nan)])
        rest = float(np.median(c.value[:100]))
        noise = rest + 1e-3 * float(np.ptp(c.value)) * random.normal(size=value.size)
        value = np.where(np.isnan(value), noise, value)
        time = np.concatenate(
            [np.arange(ahead) * step, c.time_s + ahead * step, (ahead + count + np.arange(behind)) * step]
        )
        time = clocks.setdefault(id(c.time_s), time)
        channels.append(replace(c, time_s=time, value=value, censored=np.zeros(value.size, np.int8)))
    return replace(run, log=replace(run.log, channels=tuple(channels)))


def test_a_long_record_is_cut_to_its_passage(campaign):
    run = campaign.bump_runs[0]
    long = replace(campaign, bump_runs=(longer(run, 25.0, 30.0), campaign.bump_runs[1]))
    cut, sentence = cut_to_passages(long)
    first, second = cut.bump_runs
    assert second is campaign.bump_runs[1]
    assert sentence.startswith(f"{run.log.file}: of ")
    assert "from 2 s before to 8 s after the passage" in sentence
    # All of the passage is there: the motion of every axle up to its end.
    assert first.log.duration_s < 0.5 * long.bump_runs[0].log.duration_s
    assert len({id(c.time_s) for c in first.log.channels}) == len(
        {id(c.time_s) for c in long.bump_runs[0].log.channels}
    )
    moved = first.log.start_time_s - run.log.start_time_s
    passage = find_passage(run.log.channels, campaign.vehicle, run.nominal_speed_m_s)
    assert passage is not None
    arrivals = [25.0 + arrival.time_s - moved for arrival in passage.arrivals.values()]
    assert min(arrivals) == pytest.approx(2.0, abs=0.03)
    assert first.log.duration_s - max(arrivals) == pytest.approx(8.0, abs=0.03)
    for c, o, source in zip(first.log.channels, run.log.channels, long.bump_runs[0].log.channels, strict=True):
        assert c.value.size == c.time_s.size == c.censored.size
        # Each reading keeps its time.
        at = np.searchsorted(source.time_s, c.time_s + moved - 1e-6)
        np.testing.assert_array_equal(source.value[at], c.value)
        np.testing.assert_allclose(source.time_s[at], c.time_s + moved, atol=1e-9)
        assert np.nanmax(np.abs(c.value - np.median(c.value))) >= 0.999 * np.nanmax(
            np.abs(o.value - np.median(c.value))
        )


def test_even_stamps_stay_on_the_grid(campaign):
    long = replace(campaign, bump_runs=(longer(campaign.bump_runs[0], 30.0, 30.0),))
    (run,) = cut_to_passages(long)[0].bump_runs
    steps = run.log.channels[0].time_s / run.log.sample_interval_s
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)


def test_usual_records_stay_as_they_are(campaign):
    assert cut_to_passages(campaign) == (campaign, "")
    assert cut_to_passages(read_campaign(DATA))[1] == ""


def test_a_record_without_a_passage_is_kept_whole(campaign):
    run = longer(campaign.bump_runs[0], 30.0, 30.0)
    random = np.random.default_rng(2)
    channels = tuple(replace(c, value=random.normal(size=c.value.size)) for c in run.log.channels)
    noise = replace(campaign, bump_runs=(replace(run, log=replace(run.log, channels=channels)),))
    assert cut_to_passages(noise) == (noise, "")


def test_the_check_says_what_is_used_and_looks_at_whole_records(campaign, monkeypatch):
    long = replace(campaign, bump_runs=(longer(campaign.bump_runs[0], 30.0, 30.0),))
    monkeypatch.setattr("sysid.workflow.inputs.read_campaign", lambda *a, **k: long)
    inputs = Inputs(DATA)
    assert inputs.whole.bump_runs[0].log.duration_s > 60.0
    assert inputs.campaign.bump_runs[0].log.duration_s < 30.0
    assert any("after the passage are used" in m for m in inputs.quality.messages)
