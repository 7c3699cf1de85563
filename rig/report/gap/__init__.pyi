from .page import gap_page as gap_page
from .words import (
    estimated as estimated,
    gap_words as gap_words,
    headline as headline,
    in_words as in_words,
    where_words as where_words,
)
