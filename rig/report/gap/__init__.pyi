from .page import gap_page as gap_page
from .words import (
    estimated as estimated,
    extent as extent,
    gap_words as gap_words,
    headline as headline,
    in_words as in_words,
    left_words as left_words,
    share as share,
    where_words as where_words,
)
