"""Logs of one run by several loggers: how the clock of each runs against that of the first one."""
