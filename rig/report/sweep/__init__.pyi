from .page import write_sweep_page as write_sweep_page
from .words import lines_of as lines_of
