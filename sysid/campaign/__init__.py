"""The measurement campaign: records, reader, statics and quality check (SI units, no physics beyond statics)."""

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
