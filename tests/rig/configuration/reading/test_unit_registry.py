"""What pint read of its definitions is kept, and nothing that is wrong with it changes a unit."""

from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import pytest

from rig.configuration.reading.unit_registry import unit_registry


@pytest.fixture
def cache_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    unit_registry.cache_clear()
    yield tmp_path / "cache"
    unit_registry.cache_clear()


def litres_per_minute() -> Decimal:
    """Return 60 L/min in m^3/s, by a registry that is made anew."""
    unit_registry.cache_clear()
    registry = unit_registry()
    return Decimal(registry.convert(Decimal(60), "L/min", "m^3/s"))


def kept_files(home: Path) -> list[Path]:
    return sorted((home / "hydraulic-rig-units").glob("*/*.pickle"))


def test_definitions_are_kept_and_read_again(cache_home: Path) -> None:
    assert litres_per_minute() == Decimal("1e-3")
    kept = kept_files(cache_home)
    assert kept
    written = [path.stat().st_mtime_ns for path in kept]
    assert litres_per_minute() == Decimal("1e-3")
    assert [path.stat().st_mtime_ns for path in kept_files(cache_home)] == written


def test_definitions_that_were_damaged_are_dropped(cache_home: Path) -> None:
    litres_per_minute()
    for path in kept_files(cache_home):
        path.write_bytes(path.read_bytes()[:20])
    assert litres_per_minute() == Decimal("1e-3")
    assert kept_files(cache_home) == []
    assert litres_per_minute() == Decimal("1e-3")
    assert kept_files(cache_home)


def test_without_a_place_to_keep_them_units_are_the_same(cache_home: Path) -> None:
    cache_home.write_text("a file where the folder should be")
    assert litres_per_minute() == Decimal("1e-3")


def test_a_frequency_counts_in_radians(cache_home: Path) -> None:
    registry = unit_registry()
    assert float(registry.convert(Decimal(1), "Hz", "rad/s")) == pytest.approx(6.283185307)
