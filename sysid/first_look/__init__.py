"""A first look at the folder of a logger: what its files and columns are, and a campaign file to begin with."""

from sysid.first_look.campaign_text import campaign_text
from sysid.first_look.coverage import coverage_table
from sysid.first_look.look import first_look
from sysid.first_look.records import EntryGuess, FirstLook, LoggerGuess, SeenLog, SeenScan, SensorGuess
from sysid.first_look.templates import Template, template, template_names

__all__ = [
    "EntryGuess",
    "FirstLook",
    "LoggerGuess",
    "SeenLog",
    "SeenScan",
    "SensorGuess",
    "Template",
    "campaign_text",
    "coverage_table",
    "first_look",
    "template",
    "template_names",
]
