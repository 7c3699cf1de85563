"""Hardware rigs: drivers by their own options, and every misfit refused before anything moves."""

from collections.abc import Callable
from pathlib import Path

import pytest

from faults.verdict import FAULT_KINDS
from rig.configuration import ConfigError
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.checking import check
from rig.configuration.reading.lookup import copy_shipped
from rig.configuration.rigs.rig import Rig, load_rig
from rig.io.limits import ChannelLimit
from rig.io.settings import HomingSettings, LoopSettings

pytestmark = pytest.mark.usefixtures("plain_drivers")

DAQ = (
    "{driver: plain_fast, host: daq, inputs: [position_m, pressure_1_Pa, pressure_2_Pa], "
    "outputs: [command_V]}"
)
BYPASS = (
    "{driver: plain_slow, port: ttyS0, outputs: [internal_leakage_ball, internal_leakage_needle]}"
)
BENCH = f"""
name: bench
parent: simulated
backend: hardware
supply_pressure_sensor: false
load_cell: false
spool_sensor: false
drivers:
  daq: {DAQ}
  bypass: {BYPASS}
"""

LoadText = Callable[[str], Rig]
Install = Callable[..., None]


@pytest.fixture
def load_text(tmp_path: Path) -> LoadText:
    def load(text: str) -> Rig:
        (tmp_path / "rig.yaml").write_text(text)
        return load_rig(tmp_path / "rig.yaml")

    return load


def problems_of(text: str, folder: Path) -> list[str]:
    """Return what is wrong with a rig file, as shown, without the folder."""
    (folder / "rig.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_rig(folder / "rig.yaml")
    return [str(problem).removeprefix(f"{folder}/") for problem in caught.value.problems]


def test_a_fast_driver_that_the_loop_cannot_run_on_is_reported_where_the_rig_names_it(
    install: Install, tmp_path: Path
) -> None:
    half = """
    from plain_drivers import Fast, Options, Slow

    class Half(Slow):
        kind = "fast"
        fileno = driven = None

    class Planless(Fast):
        look_plan = dict
    """
    install("halves", half, half="Half", planless="Planless")
    assert problems_of(BENCH.replace("plain_fast", "half"), tmp_path) == [
        "rig.yaml:9:9 driver: halves:Half is not a fast driver: it lacks plan, look_plan; "
        "repair or uninstall the package halves"
    ]
    assert problems_of(BENCH.replace("plain_fast", "planless"), tmp_path) == [
        "rig.yaml:9:3 daq: halves:Planless returns by look_plan() a dict, no NamedTuple with an "
        "exchange; repair or uninstall the package halves"
    ]


def test_a_hardware_rig_inherits_everything_but_its_drivers(load_text: LoadText) -> None:
    rig, simulated = load_text(BENCH), load_rig("simulated")
    assert (rig.backend, rig.pace) == ("hardware", "real")
    assert (rig.plant, rig.sensors, rig.limits) == (
        simulated.plant,
        simulated.sensors,
        simulated.limits,
    )
    assert [(spec.name, spec.type, spec.kind) for spec in rig.drivers] == [
        ("daq", "plain_fast", "fast"),
        ("bypass", "plain_slow", "slow"),
    ]
    assert (rig.loop, rig.homing) == (LoopSettings(), None)


def test_a_child_of_a_hardware_rig_inherits_drivers_and_loop(tmp_path: Path) -> None:
    (tmp_path / "bench.yaml").write_text(BENCH + "loop: {cpu: 1, overrun: realign}\n")
    (tmp_path / "child.yaml").write_text("name: child\nparent: bench\npace: real\n")
    bench, child = load_rig(tmp_path / "bench.yaml"), load_rig(tmp_path / "child.yaml")
    assert child.drivers == bench.drivers
    assert child.loop == bench.loop == LoopSettings(cpu=1, overrun="realign")


def test_a_simulated_child_of_a_hardware_rig_has_no_drivers(tmp_path: Path) -> None:
    (tmp_path / "bench.yaml").write_text(BENCH)
    (tmp_path / "dry.yaml").write_text("name: dry\nparent: bench\nbackend: simulated\n")
    assert load_rig(tmp_path / "dry.yaml").drivers == ()


def test_the_options_of_a_driver_are_read_by_their_types(load_text: LoadText) -> None:
    section = BYPASS.removesuffix("}") + (
        ", rate: 50 Hz, retries: 3, mode: harsh, verify: true, table: ../needle.csv, map: io_node}"
    )
    options = load_text(BENCH.replace(BYPASS, section)).drivers[1].options
    assert (options.rate, options.retries, options.mode, options.verify) == (50.0, 3, "harsh", True)
    assert options.table.parts[-2:] == ("..", "needle.csv")
    assert options.map.device == "generic I/O node"
    assert (options.host, options.addresses.first, options.addresses.last) == ("", 0, 7)


def test_an_option_of_several_values_may_be_given_in_part(load_text: LoadText) -> None:
    section = BYPASS.removesuffix("}") + ", addresses: {first: 3}}"
    addresses = load_text(BENCH.replace(BYPASS, section)).drivers[1].options.addresses
    assert (addresses.first, addresses.last) == (3, 9)


def test_the_settings_of_loop_and_homing_are_read_with_their_units(load_text: LoadText) -> None:
    rig = load_text(
        BENCH + "loop: {priority: 50, stale_limit: 20 ms, overrun: trip, trip_after: 3}\n"
        "homing: {end: extend, command: 300 mV, before_run: false}\n"
    )
    assert rig.loop == LoopSettings(priority=50, stale_limit=0.02, overrun="trip", trip_after=3)
    assert rig.homing == HomingSettings("extend", command=0.3, before_run=False)


def test_a_homing_command_that_would_ram_the_stop_is_refused(tmp_path: Path) -> None:
    (reported,) = problems_of(BENCH + "homing: {command: 5 V}\n", tmp_path)
    assert "command: 5 V is above 2 V" in reported


def test_without_a_word_the_ladder_holds_the_ram_and_trips_on_pressure() -> None:
    hold, far, pressure_1, pressure_2 = load_rig("simulated").ladder
    assert (hold.channel, hold.low, hold.high, hold.action) == ("position_m", 0.005, 0.6, "hold")
    assert (far.channel, far.action) == ("position_m", "trip")
    assert 0.0 < far.low < hold.low
    assert hold.high < far.high < 0.6069
    for rung in (pressure_1, pressure_2):
        assert (rung.high, rung.action) == (20e6, "trip")


LIMITS = "limits: {position: [5 mm, 0.6 m], command: 10 V, pressure: 20 MPa, channels: [%s]}\n"


def test_a_limit_of_any_channel_in_the_loop_adds_a_rung(load_text: LoadText) -> None:
    rung = (
        "{channel: pressure_1_Pa, high: 180 bar, action: ramp_down, for: 20 ms, hysteresis: 1 bar}"
    )
    rig = load_text(BENCH + LIMITS % rung)
    assert rig.ladder[-1] == ChannelLimit(
        "pressure_1_Pa", high=18e6, action="ramp_down", for_s=0.02, hysteresis=1e5
    )
    assert len(rig.ladder) == 5


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("plain_slow", "plain_slw", "rig.yaml:10:12 driver: plain_slw is not a known driver; did"),
        (BYPASS, "{port: ttyS0}", "rig.yaml:10:3 bypass: lacks the key driver; add `driver: ...`"),
        (
            "port: ttyS0",
            "prot: ttyS0",
            "rig.yaml:10:32 prot: is not a known key; did you mean port?",
        ),
        ("port: ttyS0", "rate: 3 kHz", "rig.yaml:10:32 rate: 3 kHz is above 2 kHz; did you mean"),
        ("port: ttyS0", "rate: 20", "rig.yaml:10:32 rate: 20 has no unit; write a frequency"),
        (
            "port: ttyS0",
            "mode: hash",
            "rig.yaml:10:32 mode: hash is not a choice here; did you mean",
        ),
        ("port: ttyS0", "retries: 10", "rig.yaml:10:32 retries: 10 should be less than or equal"),
        (
            "port: ttyS0",
            "map: io_nod",
            "rig.yaml:10:32 map: io_nod is not a known map; did you mean",
        ),
        (
            "port: ttyS0",
            "mode: harsh, verify: false",
            "rig.yaml:10:3 bypass: is harsh without verifying; write `verify: true`",
        ),
        (
            "plain_slow, port: ttyS0",
            "plain_fast",
            "rig.yaml:10:3 bypass: is a second fast driver beside daq; the loop has one",
        ),
        ("plain_fast", "plain_slow", "rig.yaml:8:1 drivers: have no fast driver; add one that"),
        ("command_V", "rearm", "rig.yaml:9:3 daq: does not write command_V; give it a register"),
        (
            "outputs: [internal",
            "outputs: [command_V, internal",
            "rig.yaml:10:3 bypass: command_V is written by the driver daq too; leave it out of one",
        ),
        (
            "outputs: [internal",
            "inputs: [pressure_1_Pa, position_m], outputs: [internal",
            "rig.yaml:10:3 bypass: pressure_1_Pa, position_m is read by the driver daq too; leave",
        ),
        (
            "host: daq",
            "port: ttyS0",
            "rig.yaml:10:3 bypass: ttyS0 is the connection of the driver daq too; give each",
        ),
        ("pressure_1_Pa, ", "", "rig.yaml:8:1 drivers: pressure_1_Pa is read by no driver; confi"),
        (
            "load_cell: false",
            "load_cell: true",
            "rig.yaml:6:1 load_cell: true needs a driver that reads load_N; configure one, or wri",
        ),
        (
            "spool_sensor: false",
            "spool_sensor: true",
            "rig.yaml:7:1 spool_sensor: true needs a driver that reads spool_m or drive_spool_m",
        ),
        (
            "backend: hardware",
            "backend: simulated",
            "rig.yaml:8:1 drivers: drive a simulated rig; add `backend: hardware`, or remove them",
        ),
        (
            "host: daq",
            "rate: 250 Hz",
            "rig.yaml:9:3 daq: 250 Hz is below the loop's 1 kHz; choose a faster device, or hold",
        ),
        (
            "drivers:",
            "loop: {rate: 0 Hz}\ndrivers:",
            "rig.yaml:8:8 rate: 0 Hz is below 1 Hz; at least 1 Hz",
        ),
        (
            "drivers:",
            "loop: {rate: 500 Hz}\ndrivers:",
            "rig.yaml:8:8 rate: 500 Hz is not the 1 kHz of filters and recordings; leave it out",
        ),
        (
            "drivers:",
            "loop: {overrun: hurry}\ndrivers:",
            "rig.yaml:8:8 overrun: hurry is not a choice here; choose one of skip, realign, trip",
        ),
        (
            "drivers:",
            "loop: {priority: 100}\ndrivers:",
            "rig.yaml:8:8 priority: 100 should be less than or equal to 99",
        ),
        (
            "drivers:",
            "loop: {exchange_timeout: 50 ms, stale_limit: 40 ms}\ndrivers:",
            "rig.yaml:8:8 exchange_timeout: 50 ms is not below the stale_limit of 40 ms; a late",
        ),
        (
            "drivers:",
            "homing: {end: up}\ndrivers:",
            "rig.yaml:8:10 end: up is not a choice here; choose one of retract, extend",
        ),
        (
            "drivers:",
            LIMITS % "{channel: load, high: 1 kN, action: trip}" + "drivers:",
            "rig.yaml:8:80 channel: load is not a known channel; did you mean load_N?",
        ),
        (
            "drivers:",
            LIMITS % "{channel: load_N, high: 1 kN, action: trip}" + "drivers:",
            "rig.yaml:8:68 channels: load_N has a limit and is not read by the fast driver; add it",
        ),
        (
            "drivers:",
            LIMITS % "{channel: tank_temperature_K, high: 60 K, action: indicate}" + "drivers:",
            "rig.yaml:8:68 channels: tank_temperature_K has a limit and is not read by the fast dr",
        ),
        (
            "drivers:",
            LIMITS % "{channel: position_m, high: 1 kN, action: trip}" + "drivers:",
            "rig.yaml:8:101 high: 1 kN is not a length; write a length, such as 0.3 m",
        ),
        (
            "drivers:",
            LIMITS % "{channel: position_m, high: 1 mm, low: 2 mm, action: trip}" + "drivers:",
            "rig.yaml:8:113 low: 2 mm is not below high (1 mm); swap them",
        ),
        (
            "drivers:",
            LIMITS % "{channel: position_m, action: stop}" + "drivers:",
            "rig.yaml:8:101 action: stop is not a choice here; choose one of indicate, hold, ramp",
        ),
        (
            "drivers:",
            LIMITS % "{channel: position_m, action: trip}" + "drivers:",
            "rig.yaml:8:79 position_m: has no limit; add `low: ...`, `high: ...` or both",
        ),
    ],
)
def test_a_mistake_in_a_hardware_rig_is_named_with_its_remedy(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    assert old in BENCH
    problems = problems_of(BENCH.replace(old, new, 1), tmp_path)
    assert any(problem.startswith(expected) for problem in problems), "\n".join(problems)


def test_all_mistakes_of_a_hardware_rig_are_reported_at_once(tmp_path: Path) -> None:
    text = BENCH.replace("host: daq", "rate: 9 kHz").replace("ttyS0", "ttyS0, unit: 3")
    text += "loop: {cpu: -1, watch: 1 s}\nhoming: {command: 30 V}\ncolour: red\n"
    text += LIMITS % "{channel: position_m, low: 3 bar, action: trip}"
    fields = [problem.split(" ")[1] for problem in problems_of(text, tmp_path)]
    assert sorted(fields) == ["colour:", "command:", "cpu:", "low:", "rate:", "unit:", "watch:"]


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("name: bench", "nam: bench", "nam:"),
        ("backend: hardware", "backend: hard", "backend:"),
        ("backend: hardware", "backnd: hardware", "backnd:"),
    ],
)
def test_drivers_are_no_second_mistake_of_a_rig_whose_backend_a_mistake_leaves_open(
    tmp_path: Path, old: str, new: str, field: str
) -> None:
    assert old in BENCH
    (problem,) = problems_of(BENCH.replace(old, new, 1), tmp_path)
    assert problem.split(" ")[1] == field


def test_a_hardware_rig_without_drivers_is_refused(tmp_path: Path) -> None:
    (problem,) = problems_of("name: bench\nparent: simulated\nbackend: hardware\n", tmp_path)
    assert problem.startswith("rig.yaml:1:1 drivers: are missing; add `drivers: {...}`")


def test_a_slower_device_is_accepted_if_its_values_may_be_held(load_text: LoadText) -> None:
    slower = BENCH.replace("host: daq", "rate: 250 Hz")
    rig = load_text(slower + "loop: {slower_device: hold}\n")
    assert rig.drivers[0].rate_hz == 250.0


def test_values_may_be_held_no_longer_than_the_stale_limit_lets_them(tmp_path: Path) -> None:
    slower = BENCH.replace("host: daq", "rate: 10 Hz")
    (problem,) = problems_of(slower + "loop: {slower_device: hold}\n", tmp_path)
    assert "stale_limit: 0.1 s is below two periods of daq at 10 Hz; write 0.2 s or more" in problem


def test_a_hardware_rig_injects_only_what_its_drivers_move(load_text: LoadText) -> None:
    assert load_text(BENCH).injectable == ("internal_leakage",)
    assert set(load_rig("simulated").injectable) == set(FAULT_KINDS)


@pytest.mark.parametrize(
    ("fault", "problem"),
    [
        (
            "{type: external_leakage_1, at: 18 s, needle_opening: 0.5}",
            "type: external_leakage_1 needs valves that no driver of the rig bench moves; add a "
            "driver that writes external_leakage_1_ball and external_leakage_1_needle",
        ),
        (
            "{type: return_blockage, at: 18 s, coefficient: 1e13 Pa/(m^3/s)^2}",
            "type: return_blockage needs valves that no driver of the rig bench moves; add a "
            "driver that writes return_blockage_needle",
        ),
        (
            "{type: internal_leakage, at: 18 s, linear_coefficient: 2e-12 m^3/(s Pa)}",
            "linear_coefficient: 2e-12 m^3/(s Pa) is a law no needle follows; give needle_opening",
        ),
        ("{type: internal_leakage, at: 18 s, needle_opening: 0.5}", None),
    ],
)
def test_a_campaign_may_ask_for_no_fault_that_the_drivers_cannot_make(
    tmp_path: Path, fault: str, problem: str | None
) -> None:
    (tmp_path / "bench.yaml").write_text(BENCH)
    (tmp_path / "leak.yaml").write_text(
        "name: leak\nrig: bench\ntests:\n  - name: one\n    duration: 40 s\n"
        f"    setpoint: {{type: constant, value: 0.3 m}}\n    faults: [{fault}]\n"
    )
    if problem is None:
        campaign, _ = load_campaign(tmp_path / "leak.yaml")
        assert len(campaign.tests[0].faults) == 1
        return
    with pytest.raises(ConfigError) as caught:
        load_campaign(tmp_path / "leak.yaml")
    (found,) = caught.value.problems
    assert problem in str(found)


def test_a_check_shows_the_drivers_and_which_is_slower_than_the_loop(tmp_path: Path) -> None:
    slower = BENCH.replace("host: daq", "rate: 250 Hz") + "loop: {slower_device: hold}\n"
    (tmp_path / "bench.yaml").write_text(slower)
    report = str(check(tmp_path / "bench.yaml"))
    assert "daq: plain_fast, fast, 250 Hz, slower than the loop: values held in between" in report
    assert "faults it can inject: internal_leakage" in report
    assert "hold if position_m is below 5 mm or above 600 mm for 3 ms" in report
    assert "trip if pressure_1_Pa is above 20 MPa for 3 ms" in report


def test_a_rig_with_a_broken_driver_says_whose_it_is(tmp_path: Path, install: Install) -> None:
    install("wrecked", "import nothing_of_the_kind", wrecked="Driver")
    (problem,) = problems_of(BENCH.replace("plain_slow", "wrecked"), tmp_path)
    assert "cannot be imported" in problem
    assert problem.endswith("repair or uninstall the package wrecked")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("exchange: fc23", "exchange: fc16", "exchange: fc16 is not a choice here; did you mean"),
        ("exchange: fc76", "exchange: fc23", "exchange: fc23 is not for LabJack T7; use fc76"),
        ("map: io_node", "map: bypass", "map: bypass is not a known map; available maps: io_node"),
        ("watchdog: 300 ms", "watchdog: 2 s", "watchdog: 2 s is not for generic I/O node; write"),
        ("watchdog: 300 ms", "rate: 2 kHz", "rate: 2000 Hz is not for generic I/O node; at most"),
        ("dbc: pump_unit", "dbc: servovalve", "servovalve.dbc lacks PumpStatus"),
        ("port: 15503", "port: 15502", "bypass: 127.0.0.1:15502 is the connection of the driver"),
        ("/dev/ttyUSB1", "/dev/ttyUSB0", "meters: /dev/ttyUSB0 is the connection of the driver"),
        ("slower_device: hold", "slower_device: refuse", "daq: 250 Hz is below the loop's 1 kHz"),
        ("transport: rtu", "transport: tcp", "`host` is missing, which `transport: tcp` needs"),
    ],
)
def test_a_shipped_rig_edited_wrongly_is_refused(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    copy_shipped(tmp_path / "config")
    rigs = [tmp_path / "config" / "rigs" / f"{name}.yaml" for name in ("emulated", "labjack")]
    path = next(path for path in rigs if old in path.read_text())
    assert any(
        expected in text for text in problems_of(path.read_text().replace(old, new), rigs[0].parent)
    )
