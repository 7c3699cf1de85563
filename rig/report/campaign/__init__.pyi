from .comparison import comparison_page as comparison_page
from .page import render as render, write_report as write_report
from .trend_page import TREND as TREND, trend_page as trend_page
