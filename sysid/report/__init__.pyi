from .page import render_report as render_report
from .page import write_report as write_report
from .paper_figures import write_paper_figures as write_paper_figures
from .summary import summary_pdf as summary_pdf
from .summary import write_summary as write_summary
