from .page import sweep_page as sweep_page
from .words import lines_of as lines_of
