"""All results of a calibration in one record, from which report, tables and files are made."""

from sysid.results.contents import Results

__all__ = ["Results"]
