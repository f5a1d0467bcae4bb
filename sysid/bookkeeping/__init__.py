"""What runs, drops, scan and list of a campaign say about each other, before anything is fitted."""

from sysid.bookkeeping.check import check_bookkeeping

__all__ = ["check_bookkeeping"]
