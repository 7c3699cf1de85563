"""Names of campaigns, tests and segments are shown as written, and must be fit to be shown."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from tests.rig.configuration.campaigns.written import load

TEXT = """\
name: CAMPAIGN
rig: simulated
tests:
  - name: TEST
    start_position: 0.3 m
    segments:
      - {name: SEGMENT, hold: 12 s}
"""
LINES = {"CAMPAIGN": 1, "TEST": 4, "SEGMENT": 7}


def written(**names: str) -> str:
    text = TEXT
    for what in LINES:
        text = text.replace(what, names.get(what, "a"))
    return text


@pytest.mark.parametrize("what", list(LINES))
@pytest.mark.parametrize(
    ("name", "limit"),
    [
        (r'"\e[31mred"', r"has the character \x1b, which cannot be shown"),
        (r'"a\a"', r"has the character \x07"),
        (r'"a\0"', r"has the character \x00"),
        (r'"a\nb"', r"has the character \n"),
        ('""', "is empty"),
        ('"  "', "is empty"),
    ],
)
def test_a_name_that_cannot_be_shown_is_refused(
    tmp_path: Path, what: str, name: str, limit: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, written(**{what: name}))
    (problem,) = (str(each).replace(f"{tmp_path}/", "") for each in caught.value.problems)
    assert problem.startswith(f"campaign.yaml:{LINES[what]}:")
    assert limit in problem
    assert problem.endswith("write a name of letters, digits and signs that a terminal can show")
    assert problem.isprintable()


def test_a_name_may_have_spaces_and_letters_of_any_language(tmp_path: Path) -> None:
    names = dict.fromkeys(LINES, "'Prüfung 3\xa0mm, 第一'")
    assert load(tmp_path, written(**names)).tests[0].name == names["TEST"].strip("'")


@pytest.mark.parametrize(
    ("name", "limit"),
    [(r'"a\nb"', r"a\nb has the character \n"), (r'"\e[31m"', r"\x1b"), ('""', "is empty")],
)
def test_a_name_of_an_own_figure_that_cannot_be_shown_is_refused(
    tmp_path: Path, name: str, limit: str
) -> None:
    text = written() + f"    figures:\n      {name}: {{expression: max(position_m), unit: m}}\n"
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text)
    (problem,) = (str(each).replace(f"{tmp_path}/", "") for each in caught.value.problems)
    assert problem.startswith("campaign.yaml:9:7 name: ")
    assert limit in problem
