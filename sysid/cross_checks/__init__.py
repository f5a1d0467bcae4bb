"""What runs, drops, scan and list of a campaign say about each other, before anything is fitted."""

from sysid.cross_checks.check import cross_check

__all__ = ["cross_check"]
