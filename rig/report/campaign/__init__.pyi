from .page import render as render, write_report as write_report
from .several_runs import (
    TREND as TREND,
    comparison_page as comparison_page,
    trend_page as trend_page,
)
