from .comparison import write_comparison as write_comparison
from .page import render as render, write_report as write_report
from .trend_page import TREND as TREND, write_trend as write_trend
