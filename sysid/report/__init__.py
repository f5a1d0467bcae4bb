"""One self-contained HTML report of everything that has been found so far."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.report.page import render_report, write_report
    from sysid.report.paper_figures import write_paper_figures

_HOMES = {
    "render_report": "sysid.report.page",
    "write_paper_figures": "sysid.report.paper_figures",
    "write_report": "sysid.report.page",
}

__all__ = ["render_report", "write_paper_figures", "write_report"]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
