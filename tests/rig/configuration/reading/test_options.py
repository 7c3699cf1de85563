"""Options declare themselves: what is taken if nothing is given is allowed, and has a meaning."""

import pytest
from hypothesis import given, strategies as st

from rig.configuration.reading.document import Located, Sources
from rig.configuration.reading.options import kind_of, options_of, read_options
from rig.configuration.reading.problems import Place
from rig.io.modbus_daq.register_map import RegisterMap
from rig.io.registry import driver_class
from rig.io.settings import HomingSettings, LoopSettings
from rig.plant.sensors import SensorParameters
from tools.pages.configuration import PAGE, keys_table

SHIPPED = ("modbus_daq", "bypass_valves", "can_valve", "can_pump", "flow_meters")
CLASSES = [
    LoopSettings,
    HomingSettings,
    SensorParameters,
    RegisterMap,
    *(driver_class(name).Options for name in SHIPPED),
]


def section(**keys: object) -> Located:
    """Return a section of a rig file with these keys."""
    place, sources = Place(PAGE, 1, 1), Sources()
    entries = {key: Located(value, place, key, sources) for key, value in keys.items()}
    return Located(entries, place, "loop", sources)


@pytest.mark.parametrize("options", CLASSES, ids=lambda options: options.__name__)
def test_every_default_is_within_its_limits(options: type) -> None:
    for name, option in options_of(options).items():
        quantity, default = option.quantity, option.default
        if quantity is not None:
            assert kind_of(option) in (int, float), name
            assert quantity.lower < quantity.upper, name
            if isinstance(default, int | float):
                assert quantity.lower <= default <= quantity.upper, name


@pytest.mark.parametrize("name", [*SHIPPED, "loop", "homing", "register_map"])
def test_every_option_has_a_meaning(name: str) -> None:
    _, _, *rows = keys_table(name)
    assert rows
    for row in rows:
        assert not row.endswith("|  |"), row


@given(st.integers(1, 10_000))
def test_a_time_is_the_same_in_every_unit(milliseconds: int) -> None:
    times = [
        read_options(LoopSettings, section(stale_limit=text))
        for text in (f"{milliseconds} ms", f"{milliseconds}e-3 s", f"{milliseconds}e3 us")
    ]
    assert {settings.stale_limit for settings in times if settings} == {milliseconds / 1000}


@given(st.integers(-1000, 1000))
def test_a_number_is_taken_exactly_if_it_is_within_its_limits(priority: int) -> None:
    item = section(priority=priority)
    settings = read_options(LoopSettings, item)
    allowed = 0 <= priority <= 99
    assert (settings == LoopSettings(priority=priority)) == allowed
    assert bool(item.sources.problems.found) != allowed
