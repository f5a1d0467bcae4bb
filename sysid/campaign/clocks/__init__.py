"""Logs of one run by several loggers: the clock of each relative to that of the first one."""
