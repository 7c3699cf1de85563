"""The table of channels says each thing once, and the order of what was recorded stays."""

from rig.channels import CHANNELS, READINGS, SHOWN, Kind, Source, names_from, names_of
from rig.io.signals import BALLS, FAST_INPUTS, NEEDLES, SLOW_INPUTS
from rig.plant import Reading
from rig.recording.units import unit_of

SI_OF_SCREEN = {"mm": "m", "MPa": "Pa", "kN": "N", "V": "V", "L/min": "m^3/s", "°C": "K"}


def test_no_channel_stands_in_it_twice() -> None:
    names = [channel.name for channel in CHANNELS]
    assert len(set(names)) == len(names)


def test_readings_are_those_of_the_plant() -> None:
    fields = [name.removesuffix(f"_{suffix}") for name, suffix in zip(
        READINGS, ("m", "Pa", "Pa", "m", "Pa", "N", *["m3_per_s"] * 3), strict=True
    )]  # fmt: skip
    assert tuple(fields) == Reading._fields


def test_the_orders_of_shared_memory_stay() -> None:
    assert FAST_INPUTS[:17] == (
        *READINGS, "estop_closed", "reset_button", "valve_enabled", "watchdog_tripped",
        "encoder_fault", "device_counter", "device_echo", "device_command_V",
    )  # fmt: skip
    assert SLOW_INPUTS[:19] == (
        *names_from(Source.METERS), *BALLS, *NEEDLES, "drive_state", "drive_spool_m",
        "drive_setpoint", "pump_pressure_Pa", "oil_temperature_K", "pump_loaded",
    )  # fmt: skip
    assert SLOW_INPUTS[3:] == names_of(Kind.SLOW)


def test_a_channel_is_shown_in_a_unit_of_what_its_name_says() -> None:
    for name, shown in SHOWN:
        assert unit_of(name) == SI_OF_SCREEN[shown.unit.text]


def test_a_temperature_is_shown_in_degrees_celsius() -> None:
    shown = dict(SHOWN)["oil_temperature_K"]
    assert f"{shown.unit.shown(313.15):.{shown.digits}f} {shown.unit.text}" == "40.0 °C"
