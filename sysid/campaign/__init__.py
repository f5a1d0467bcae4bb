"""The measurement campaign: records, reader, statics and quality check (SI units, no physics beyond statics)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.campaign.findings import ChannelFinding, QualityReport, Verdict
    from sysid.campaign.inputs.bumps import PointCloudReader
    from sysid.campaign.inputs.logs import read_log
    from sysid.campaign.priors import PriorOverride
    from sysid.campaign.quality.check import check_quality, quality_table
    from sysid.campaign.read import read_campaign
    from sysid.campaign.records import (
        Acquisition,
        AntiAliasFilter,
        BumpRun,
        BumpShape,
        Campaign,
        Channel,
        Log,
        PlankDrop,
        PredictionRequest,
        Scan,
        Sensor,
        SensorKind,
    )
    from sysid.campaign.statics import StaticEquilibrium, check_statics, static_equilibrium
    from sysid.campaign.vehicle_records import Axle, AxleGroup, Body, LeafDimensions, LoadCase, Vehicle
    from sysid.logs.input_file import InputFile

_HOMES = {
    "Acquisition": "sysid.campaign.records",
    "AntiAliasFilter": "sysid.campaign.records",
    "Axle": "sysid.campaign.vehicle_records",
    "AxleGroup": "sysid.campaign.vehicle_records",
    "Body": "sysid.campaign.vehicle_records",
    "BumpRun": "sysid.campaign.records",
    "BumpShape": "sysid.campaign.records",
    "Campaign": "sysid.campaign.records",
    "Channel": "sysid.campaign.records",
    "ChannelFinding": "sysid.campaign.findings",
    "InputFile": "sysid.logs.input_file",
    "LeafDimensions": "sysid.campaign.vehicle_records",
    "LoadCase": "sysid.campaign.vehicle_records",
    "Log": "sysid.campaign.records",
    "PlankDrop": "sysid.campaign.records",
    "PointCloudReader": "sysid.campaign.inputs.bumps",
    "PredictionRequest": "sysid.campaign.records",
    "PriorOverride": "sysid.campaign.priors",
    "QualityReport": "sysid.campaign.findings",
    "Scan": "sysid.campaign.records",
    "Sensor": "sysid.campaign.records",
    "SensorKind": "sysid.campaign.records",
    "StaticEquilibrium": "sysid.campaign.statics",
    "Vehicle": "sysid.campaign.vehicle_records",
    "Verdict": "sysid.campaign.findings",
    "check_quality": "sysid.campaign.quality.check",
    "check_statics": "sysid.campaign.statics",
    "quality_table": "sysid.campaign.quality.check",
    "read_campaign": "sysid.campaign.read",
    "read_log": "sysid.campaign.inputs.logs",
    "static_equilibrium": "sysid.campaign.statics",
}

__all__ = [
    "Acquisition",
    "AntiAliasFilter",
    "Axle",
    "AxleGroup",
    "Body",
    "BumpRun",
    "BumpShape",
    "Campaign",
    "Channel",
    "ChannelFinding",
    "InputFile",
    "LeafDimensions",
    "LoadCase",
    "Log",
    "PlankDrop",
    "PointCloudReader",
    "PredictionRequest",
    "PriorOverride",
    "QualityReport",
    "Scan",
    "Sensor",
    "SensorKind",
    "StaticEquilibrium",
    "Vehicle",
    "Verdict",
    "check_quality",
    "check_statics",
    "quality_table",
    "read_campaign",
    "read_log",
    "static_equilibrium",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
