"""[[vehicle.group]] with kind = "equaliser": what is read, and the sentence that each fault ends in."""

from __future__ import annotations

import pytest

from sysid.campaign import read_campaign
from sysid.errors import CampaignError

GROUP = '\n[[vehicle.group]]\nname = "rocker"\naxles = ["front", "rear"]\n'


def with_group(small, keys: str):
    return small(("[load_case.", f"{GROUP}{keys}\n\n[load_case."))


def test_a_rocker_leaves_every_axle_its_own_suspension(small):
    vehicle = read_campaign(with_group(small, 'kind = "equaliser"\nload_share = 0.8')).vehicle
    (rocker,) = vehicle.equalisers
    assert (rocker.name, rocker.axles, rocker.load_share) == ("rocker", (0, 1), 0.8)
    assert vehicle.groups == ()
    assert vehicle.suspension_axle == (0, 1)
    assert read_campaign(with_group(small, 'kind = "equaliser"')).vehicle.equalisers[0].load_share is None


@pytest.mark.parametrize(
    ("keys", "part"),
    [
        ("", "lacks mass_kg and pitch_inertia_kg_m2"),
        ('kind = "rocker"', "equaliser"),
        ('kind = "equaliser"\nmass_kg = 100', "rocker without mass"),
        ('kind = "equaliser"\nload_share = 1.1', "load_share"),
        ("mass_kg = 100\npitch_inertia_kg_m2 = 50\nload_share = 0.5", "belongs to kind"),
    ],
)
def test_each_fault_is_a_sentence(small, keys, part):
    with pytest.raises(CampaignError) as error:
        read_campaign(with_group(small, keys))
    assert part in str(error.value)
    assert "\n" not in str(error.value)


def test_one_axle_has_nothing_to_share(small):
    folder = small(
        ("[load_case.", '[[vehicle.group]]\nname = "a"\nkind = "equaliser"\naxles = ["rear"]\n\n[load_case.')
    )
    with pytest.raises(CampaignError, match="needs two or more"):
        read_campaign(folder)
