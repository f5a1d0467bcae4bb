"""The campaign that stages work on: as read, and as screened by the quality check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path

from sysid.campaign.findings import QualityReport
from sysid.campaign.passage.cut import cut_to_passages
from sysid.campaign.quality.check import check_quality
from sysid.campaign.read import read_campaign
from sysid.campaign.records import Campaign
from sysid.estimation.parameters.checked_priors import check_priors
from sysid.road.point_cloud import read_point_cloud
from sysid.road.profile_files import bump_from_file, road_from_file


class Inputs:
    """One campaign, read and screened once.

    Raises
    ------
    CampaignError
        If the campaign file is wrong.
    DataRejectedError
        If a log cannot be read.
    """

    def __init__(self, campaign: str | Path):
        self.read = read_campaign(
            campaign,
            point_cloud_reader=read_point_cloud,
            profile_reader=bump_from_file,
            road_reader=road_from_file,
        )
        check_priors(self.read)

    @property
    def sha256(self) -> Mapping[str, str]:
        """Hash of every input file."""
        return self.read.input_sha256

    @property
    def whole(self) -> Campaign:
        """The campaign with rejected channels removed and clipped samples marked."""
        return self._screened[0]

    @property
    def campaign(self) -> Campaign:
        """The same with long records cut to the passage."""
        return self._cut[0]

    @property
    def quality(self) -> QualityReport:
        """What the check found in every channel, and which records were cut."""
        report, sentence = self._screened[1], self._cut[1]
        return replace(report, messages=(*report.messages, sentence)) if sentence else report

    @cached_property
    def _cut(self) -> tuple[Campaign, str]:
        return cut_to_passages(self.whole)

    @cached_property
    def _screened(self) -> tuple[Campaign, QualityReport]:
        return check_quality(self.read)
