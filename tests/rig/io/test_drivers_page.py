"""The examples of docs/drivers.md run as they stand."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.io.conformance import CHECKS, Check
from rig.io.flow_meters.lines import MeterLineParser
from rig.io.registry import DriverSpec, driver_class

PAGE = (Path(__file__).parents[3] / "docs" / "drivers.md").read_text()
DRIVER, FAST, TEST = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(autouse=True)
def _installed(install: Callable[..., None]) -> None:
    (line,) = re.findall(r'^pump_relay = "pump_relay:(\w+)"$', PAGE, re.MULTILINE)
    install("pump_relay", DRIVER, pump_relay=line)


def test_the_example_is_found_by_its_entry_point(tmp_path: Path) -> None:
    pin = tmp_path / "value"
    pin.write_text("0")
    options = driver_class("pump_relay").Options(pin=pin)

    driver = DriverSpec.of("pump", "pump_relay", options).create()
    driver.open()
    driver.write({"pump_load": 1.0})

    assert driver.read() == {"pump_loaded": 1.0}
    assert pin.read_text() == "1"


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_example_conforms_as_its_own_test_says(check: Check, tmp_path: Path) -> None:
    test: dict[str, Any] = {}
    exec(compile(TEST, "the example's test", "exec"), test)

    test["test_the_relay_conforms"](check, tmp_path)


def test_the_exchange_on_the_page_is_that_of_a_driver_that_is_tested() -> None:
    assert FAST in Path(__file__).with_name("datagram_daq.py").read_text()


def test_the_page_names_every_check_with_what_it_asks() -> None:
    asked = [
        (check.__name__, (check.__doc__ or "").partition(".\n")[0].rstrip(".")) for check in CHECKS
    ]

    assert re.findall(r"^\| `(check_\w+)` \| (.*) \|$", PAGE, re.MULTILINE) == asked


def test_the_line_of_a_meter_on_the_page_is_one() -> None:
    (line,) = re.findall(r"`(\$FM[^`]*)`", PAGE)

    assert MeterLineParser().feed(line.encode() + b"\r\n")
