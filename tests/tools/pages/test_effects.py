"""The page of the model lists the catalogue of effects as it is."""

from rig.plant import CATALOGUE
from tools.pages.effects import NAME, PAGE, effects_table
from tools.pages.marked_tables import filled


def test_the_page_has_the_table_of_the_catalogue() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert filled(page, {NAME: effects_table()}) == page, "run `python -m tools.pages.effects`"


def test_every_effect_has_a_row_of_its_own() -> None:
    rows = effects_table().splitlines()[2:]
    assert [row.split("`")[1] for row in rows] == list(CATALOGUE)
