"""One self-contained HTML report of everything that has been found so far."""

from sysid.report.page import render_report, write_report

__all__ = ["render_report", "write_report"]
