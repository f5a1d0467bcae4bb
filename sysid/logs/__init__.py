"""Files of loggers: from the bytes of a file to channels with their own time, whatever the format."""

from sysid.logs.channels import Clock, LogContent, LogFormat, LogRequest, RawChannel
from sysid.logs.input_file import InputFile
from sysid.logs.registry import FORMATS, format_of, read_channels

__all__ = [
    "FORMATS",
    "Clock",
    "InputFile",
    "LogContent",
    "LogFormat",
    "LogRequest",
    "RawChannel",
    "format_of",
    "read_channels",
]
