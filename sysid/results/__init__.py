"""What the stages of a calibration have found, together: the record that report, tables and files are made from."""

from sysid.results.contents import Results

__all__ = ["Results"]
