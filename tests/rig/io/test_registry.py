"""Drivers are found by entry points: the shipped ones, and those of third parties."""

import pickle
from collections.abc import Callable

import pytest

from rig.io.driver import DriverError
from rig.io.registry import DriverSpec, driver_class, driver_types

Install = Callable[..., None]

FAST = """
from dataclasses import make_dataclass

class Driver:
    kind, Options, rate_hz = "fast", make_dataclass("Options", ()), 1000.0
    inputs = outputs = ()
    open = read = write = safe_state = close = print

    def __init__(self, name, options): ...
"""


def test_the_shipped_drivers_are_found() -> None:
    shipped = {"modbus_daq", "bypass_valves", "can_valve", "can_pump", "flow_meters"}
    assert shipped <= set(driver_types())


@pytest.mark.usefixtures("plain_drivers")
def test_a_third_party_adds_a_driver_by_an_entry_point() -> None:
    assert {"plain_fast", "plain_slow"} <= set(driver_types())
    assert driver_class("plain_fast").kind == "fast"


@pytest.mark.usefixtures("plain_drivers")
def test_a_specification_tells_what_the_driver_reads_and_writes_and_makes_it_elsewhere() -> None:
    options = driver_class("plain_slow").Options(inputs=("load_N",), outputs=("pump_load",))
    spec = pickle.loads(pickle.dumps(DriverSpec.of("pump", "plain_slow", options)))
    assert (spec.kind, spec.inputs, spec.outputs) == ("slow", ("load_N",), ("pump_load",))
    assert (spec.path, spec.rate_hz) == ("plain_drivers:Slow", 1000.0)
    assert spec.create().name == "pump"


def test_a_driver_that_cannot_be_imported_hurts_only_those_who_ask_for_it(install: Install) -> None:
    install("wrecked", "import nothing_of_the_kind", wrecked="Driver")
    assert {"wrecked", "bypass_valves"} <= set(driver_types())
    assert driver_class("bypass_valves").kind == "slow"
    with pytest.raises(
        DriverError, match=r"No module named 'nothing_of_the_kind'.*package wrecked"
    ):
        driver_class("wrecked")


def test_a_driver_of_two_packages_is_refused_naming_both(install: Install) -> None:
    install("acme_rig", "class Driver: ...", siren="Driver")
    install("bolt_rig", "class Driver: ...", siren="Driver")
    with pytest.raises(DriverError, match="siren: is a driver of acme_rig and bolt_rig"):
        driver_class("siren")


@pytest.mark.parametrize(
    ("source", "lacks"),
    [
        ("Driver = 3", "it lacks kind, Options, open, read, write, safe_state, close"),
        (
            "class Driver:\n    kind = 'slow'\n    Options = dict\n"
            "    open = read = write = safe_state = close = print",
            "it lacks a dataclass Options",
        ),
        (
            f"{FAST}\n    fileno = driven = print",
            "stranger:Driver is not a fast driver: it lacks plan, look_plan",
        ),
    ],
)
def test_an_entry_point_that_names_no_driver_is_refused(
    install: Install, source: str, lacks: str
) -> None:
    install("stranger", source, stranger="Driver")
    with pytest.raises(DriverError, match=lacks):
        driver_class("stranger")


def test_a_fast_driver_whose_plan_brings_no_exchange_is_refused(install: Install) -> None:
    install(
        "stranger",
        f"{FAST}\n    fileno = driven = print\n    plan = look_plan = dict",
        stranger="Driver",
    )
    with pytest.raises(
        DriverError, match=r"returns by plan\(\) a dict, no NamedTuple with an exch"
    ):
        DriverSpec.of("daq", "stranger", None)


@pytest.mark.usefixtures("plain_drivers")
def test_only_a_fast_driver_is_made_for_the_loop() -> None:
    options = driver_class("plain_fast").Options(outputs=("command_V",))
    assert DriverSpec.of("daq", "plain_fast", options).create_fast().name == "daq"
    with pytest.raises(DriverError, match="plain_drivers:Slow is not a fast driver"):
        DriverSpec.of("daq", "plain_slow", options).create_fast()


def test_an_unknown_type_is_refused_with_the_known_ones() -> None:
    with pytest.raises(DriverError, match=r"telepathy: is not a known driver.*bypass_valves"):
        driver_class("telepathy")
