"""Factors of usual units are kept between processes, and what is damaged is worked out anew."""

from decimal import Decimal
from pathlib import Path

import pytest

from rig.configuration.reading.kept_factors import kept_factors

FACTORS = {("MPa", "Pa"): Decimal("1e6"), ("mm", "m"): Decimal("0.001"), ("mm", "Pa"): None}
PAIRS = [*FACTORS]


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def asked(*definitions: str) -> tuple[dict[tuple[str, str], Decimal | None], int]:
    """Return the factors, and how many of them had to be worked out."""
    worked_out: list[tuple[str, str]] = []

    def factor(unit: str, si_unit: str) -> Decimal | None:
        worked_out.append((unit, si_unit))
        return FACTORS[unit, si_unit]

    return kept_factors(PAIRS, definitions, factor), len(worked_out)


def test_they_are_worked_out_once_for_each_meaning_of_the_units(home: Path) -> None:
    assert asked("one") == (FACTORS, 3)
    assert asked("one") == (FACTORS, 0)
    assert asked("another") == (FACTORS, 3)


@pytest.mark.parametrize("damage", [b"", b"\xff", b"1e7", b'["1e7", "0.001", null]'])
def test_a_damaged_file_changes_no_unit(home: Path, damage: bytes) -> None:
    asked()
    (file,) = (home / "hydraulic-rig-units").iterdir()
    digest = file.read_bytes().partition(b"\n")[0]
    file.write_bytes(digest + b"\n" + damage)
    assert asked() == (FACTORS, 3)
    assert asked() == (FACTORS, 0)


def test_where_nothing_can_be_kept_nothing_is_worked_out_beforehand(home: Path) -> None:
    home.write_text("a file where the folder should be")
    assert asked() == ({}, 0)
