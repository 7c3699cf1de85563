from .asked_words import asked_lines as asked_lines
from .page import sweep_page as sweep_page
from .words import lines_of as lines_of
