"""bending = {...} of a body: what is read, and the sentence that each fault ends in."""

from __future__ import annotations

import pytest

from sysid.campaign import read_campaign
from sysid.campaign.vehicle_records import FrameBending
from sysid.errors import CampaignError
from sysid.estimation.parameters.campaign_parameters import campaign_parameters


def bent(small, keys: str):
    return small(('name = "frame"', f'name = "frame"\nbending = {{ {keys} }}'))


def test_a_frame_and_its_parameters(small):
    campaign = read_campaign(bent(small, "frequency_hz = 8.5"))
    assert campaign.vehicle.bodies[0].bending == FrameBending(8.5, 0.025)
    by_name = {p.name: p for p in campaign_parameters(campaign, None).parameters}
    frequency, ratio = by_name["bending_hz[frame]"], by_name["bending_ratio[frame]"]
    assert (frequency.unit, frequency.prior_median, frequency.prior_sd) == ("Hz", 8.5, 0.1)
    assert (ratio.unit, ratio.prior_median, ratio.prior_sd) == ("1", 0.025, 0.5)
    shape = "shape = { x_m = [-1, 0, 2, 4, 5], rise = [2, 1, -1, 1, 2] }"
    found = read_campaign(bent(small, f"frequency_hz = 8, damping_ratio = 0.03, {shape}")).vehicle.bodies[0].bending
    assert found == FrameBending(8.0, 0.03, (-1, 0, 2, 4, 5), (2, 1, -1, 1, 2))


@pytest.mark.parametrize(
    ("keys", "part"),
    [
        ("damping_ratio = 0.02", "frequency_hz"),
        ("frequency_hz = 0.1", "frequency_hz"),
        ("frequency_hz = 8, damping_ratio = 1.5", "damping_ratio"),
        ("frequency_hz = 8, shape = { x_m = [0, 1, 2, 3], rise = [0, 1, 2, 3] }", "straight line"),
        ("frequency_hz = 8, shape = { x_m = [0, 1, 2, 3], rise = [0, 1, 2] }", "4"),
        ("frequency_hz = 8, shape = { x_m = [0, 2, 1, 3], rise = [0, 1, 2, 0] }", "do not increase"),
    ],
)
def test_each_fault_is_a_sentence(small, keys, part):
    with pytest.raises(CampaignError) as error:
        read_campaign(bent(small, keys))
    assert part in str(error.value)
    assert "\n" not in str(error.value)


def test_a_prior_of_the_frequency_in_hertz(small):
    folder = small(
        ('name = "frame"', 'name = "frame"\nbending = { frequency_hz = 8 }'),
        ("[acquisition]", '[priors]\n"bending_hz[frame]" = { median_Hz = 9, log_sd = 0.05 }\n\n[acquisition]'),
    )
    by_name = {p.name: p for p in campaign_parameters(read_campaign(folder), None).parameters}
    assert (by_name["bending_hz[frame]"].prior_median, by_name["bending_hz[frame]"].prior_sd) == (9.0, 0.05)
