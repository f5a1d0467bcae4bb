"""One self-contained HTML report of everything that has been found so far."""

from sysid.report.page import render_report, write_report
from sysid.report.paper_figures import write_paper_figures

__all__ = ["render_report", "write_paper_figures", "write_report"]
