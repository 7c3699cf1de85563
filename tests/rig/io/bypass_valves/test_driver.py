from math import isnan
from typing import Any

import pytest

from rig.channels import BYPASSES
from rig.io.driver import Driver, DriverError
from tests.rig.io.conftest import BypassBench
from tests.waiting import until

BALL, NEEDLE = "internal_leakage_ball", "internal_leakage_needle"
THROTTLE = "return_blockage_needle"
SHUT = {f"{bypass}_ball": 0.0 for bypass in BYPASSES[:-1]}


def events(bypass: BypassBench, kind: str) -> list[dict[str, Any]]:
    return [event for event in list(bypass.record.events) if event["event"] == kind]


def test_it_is_a_driver_of_every_valve_that_the_rig_has(bypass: BypassBench) -> None:
    driver = bypass.driver(bypasses=("external_leakage_2", "return_blockage"))

    assert isinstance(driver, Driver)
    assert driver.outputs == (
        "external_leakage_2_ball",
        "external_leakage_2_needle",
        "return_blockage_needle",
    )
    assert driver.inputs == driver.outputs


def test_opening_it_moves_nothing(bypass: BypassBench) -> None:
    driver = bypass.driver()

    driver.open()
    bypass.clock.advance(5.0)

    assert set(driver.read().values()) == {0.0}
    assert not events(bypass, "ball_ordered")
    assert not events(bypass, "needle_ordered")


def test_a_ball_travels_until_its_switch_confirms_it(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()

    driver.write({BALL: 1.0})
    under_way = driver.read()[BALL]
    bypass.clock.advance(0.4)
    still_under_way = driver.read()[BALL]
    bypass.clock.advance(0.1)

    # It has not left its switch yet when it is first looked at.
    assert (under_way, still_under_way, driver.read()[BALL]) == (0.0, 0.5, 1.0)


def test_a_needle_slews_to_its_setpoint_and_says_where_it_is(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()

    driver.write({NEEDLE: 0.5})
    bypass.clock.advance(0.5)
    assert driver.read()[NEEDLE] == pytest.approx(0.25)
    bypass.clock.advance(10.0)

    assert driver.read()[NEEDLE] == 0.5


def test_it_serves_a_serial_line_as_it_serves_tcp(bypass: BypassBench) -> None:
    driver = bypass.serial_driver(watchdog=0.0, baud=115_200)
    driver.open()

    driver.write({BALL: 1.0, NEEDLE: 0.5})
    bypass.clock.advance(2.0)
    opened = driver.read()
    driver.safe_state()

    assert (opened[BALL], opened[NEEDLE]) == (1.0, 0.5)
    assert driver.read()[BALL] == 0.0


def test_writing_the_same_again_begins_no_second_move(bypass: BypassBench) -> None:
    driver = bypass.driver()
    driver.open()

    driver.write({BALL: 1.0})
    driver.write({BALL: 1.0})

    assert len(events(bypass, "ball_ordered")) == 1


def test_a_valve_that_has_arrived_may_be_sent_elsewhere(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()
    driver.write({NEEDLE: 0.5})
    bypass.clock.advance(1.0)
    driver.read()

    driver.write({NEEDLE: 0.25})
    bypass.clock.advance(0.25)

    assert driver.read()[NEEDLE] == pytest.approx(0.375)


def test_a_stuck_needle_is_named_with_where_it_stands_and_how_long_it_took(
    bypass: BypassBench,
) -> None:
    driver = bypass.driver(watchdog=0.0, needle_travel=0.5, margin=1.0)
    driver.open()
    driver.write({NEEDLE: 1.0})
    bypass.clock.advance(0.84)
    bypass.device.valves.stick("internal_leakage")
    bypass.clock.advance(0.65)
    driver.read()  # there is time left

    bypass.clock.advance(0.01)
    with pytest.raises(DriverError) as caught:
        driver.read()

    assert caught.value.channel == NEEDLE
    assert caught.value.state == "stuck at 0.42 after 1.5 s, sent to 1"
    assert caught.value.driver == "bypass"
    assert caught.value.action


def test_a_stuck_ball_is_named_and_so_is_every_other_one(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()
    for stuck in BYPASSES[:2]:
        bypass.device.valves.stick(stuck)

    driver.write({f"{stuck}_ball": 1.0 for stuck in BYPASSES[:2]})
    bypass.clock.advance(1.5)

    with pytest.raises(DriverError, match=r"_1_ball, external_leakage_2_ball: stuck at 0 after"):
        driver.read()


def test_a_stuck_valve_that_comes_loose_is_no_fault_any_more(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()
    bypass.device.valves.stick("internal_leakage")
    driver.write({BALL: 1.0})
    bypass.clock.advance(1.5)
    with pytest.raises(DriverError):
        driver.read()

    bypass.device.valves.stick("internal_leakage", stuck=False)
    bypass.clock.advance(0.5)

    assert driver.read()[BALL] == 1.0


def test_a_needle_that_leaves_its_setpoint_is_a_fault(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()
    driver.write({NEEDLE: 0.5})
    bypass.clock.advance(2.0)
    driver.read()

    bypass.device.valves.order_needle("internal_leakage", 0.6)  # by somebody else
    bypass.clock.advance(2.0)

    with pytest.raises(DriverError, match=r"has left 0\.5 and stands at 0\.6"):
        driver.read()


def test_a_ball_with_both_switches_on_has_no_position(bypass: BypassBench) -> None:
    bypass.device.shorted.add("internal_leakage")
    driver = bypass.driver(watchdog=0.0)
    driver.open()

    assert isnan(driver.read()[BALL])

    driver.write({BALL: 1.0})
    bypass.clock.advance(1.5)
    with pytest.raises(DriverError, match="internal_leakage_ball: stuck with both switches on"):
        driver.read()


@pytest.mark.parametrize(
    ("outputs", "channel", "state"),
    [
        ({"command_V": 1.0}, "command_V", "is not an output"),
        ({"return_blockage_ball": 1.0}, "return_blockage_ball", "is not an output"),
        ({BALL: 0.5}, BALL, "0.5 is neither 0 nor 1"),
        ({NEEDLE: 1.01}, NEEDLE, "1.01 is not 0 to 1"),
        ({NEEDLE: float("nan")}, NEEDLE, "nan is not 0 to 1"),
    ],
)
def test_of_outputs_one_of_which_is_wrong_none_is_sent(
    bypass: BypassBench, outputs: dict[str, float], channel: str, state: str
) -> None:
    driver = bypass.driver()
    driver.open()

    with pytest.raises(DriverError) as caught:
        driver.write({"external_leakage_1_ball": 1.0, **outputs})

    assert (caught.value.channel, caught.value.state) == (channel, state)
    assert not events(bypass, "ball_ordered")


def test_the_safe_state_shuts_every_ball_and_frees_the_throttle(bypass: BypassBench) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()
    driver.write({**dict.fromkeys(SHUT, 1.0), NEEDLE: 0.5, THROTTLE: 0.7})
    bypass.clock.advance(2.0)
    driver.read()

    driver.safe_state()

    positions = bypass.device.valves.positions()
    assert {name: ball for name, (ball, _) in positions.items() if name in BYPASSES[:-1]} == (
        dict.fromkeys(BYPASSES[:-1], 0.0)
    )
    # There may be a hundredth left: the throttle is free before it stands still.
    assert positions["return_blockage"][1] <= 0.02
    assert positions["internal_leakage"][1] == 0.5


def test_the_safe_state_needs_no_open_and_no_connection_of_before(bypass: BypassBench) -> None:
    bypass.device.valves.order_ball("supply_leakage", opened=True)
    bypass.clock.advance(1.0)
    never_opened, cut_off = bypass.driver(), bypass.driver()
    cut_off.open()
    bypass.disconnect()

    never_opened.safe_state()
    cut_off.safe_state()

    assert bypass.device.valves.positions()["supply_leakage"][0] == 0.0


def test_the_safe_state_trusts_no_connection_that_it_finds(bypass: BypassBench) -> None:
    driver = bypass.driver()
    driver.open()
    assert len(events(bypass, "connected")) == 1

    driver.safe_state()

    assert len(events(bypass, "connected")) == 2


def test_a_safe_state_that_is_not_reached_names_the_valves_that_are_not(
    bypass: BypassBench,
) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()
    driver.write(dict.fromkeys(SHUT, 1.0))
    bypass.clock.advance(1.0)
    bypass.device.valves.stick("supply_leakage")

    with pytest.raises(DriverError) as caught:
        driver.safe_state()

    assert caught.value.channel == "supply_leakage_ball"
    assert caught.value.state == "not shut, stands at 1"
    balls = [ball for ball, _ in bypass.device.valves.positions().values()]
    assert balls[:4] == [0.0, 0.0, 0.0, 1.0]


def test_the_safe_state_of_a_device_that_is_gone_fails_and_ends(bypass: BypassBench) -> None:
    driver = bypass.driver()
    driver.open()
    bypass.power_off()

    with pytest.raises(DriverError, match=r"cannot connect to 127\.0\.0\.1"):
        driver.safe_state()


@pytest.mark.parametrize("fault", ["replies_lost", "garbage", "wrong_transaction"])
def test_the_balls_of_a_device_that_hears_but_does_not_answer_are_shut_unconfirmed(
    bypass: BypassBench, fault: str
) -> None:
    driver = bypass.driver(bypass.clock.advance, watchdog=0.0)
    driver.open()
    driver.write(dict.fromkeys(SHUT, 1.0))
    bypass.clock.advance(1.0)

    with bypass.unanswered(fault), pytest.raises(DriverError, match="no valid reply"):
        driver.safe_state()

    # What the device was sent it may still have to hear.
    until(lambda: [event["opened"] for event in events(bypass, "ball_ordered")].count(False) == 4)
    bypass.clock.advance(1.0)
    assert [ball for ball, _ in bypass.device.valves.positions().values()][:4] == [0.0] * 4


def test_the_safe_state_outlasts_a_device_that_refuses_for_a_while(bypass: BypassBench) -> None:
    slept = []

    def sleep(time_s: float) -> None:
        slept.append(time_s)
        bypass.clock.advance(time_s)
        bypass.device.wire.exception = 0

    driver = bypass.driver(sleep, watchdog=0.0)
    driver.open()
    driver.write({BALL: 1.0})
    bypass.clock.advance(1.0)
    bypass.device.wire.exception = 6

    driver.safe_state()

    assert slept
    assert bypass.device.valves.positions()["internal_leakage"][0] == 0.0


def test_the_devices_own_watchdog_shuts_the_valves_of_a_driver_that_falls_silent(
    bypass: BypassBench,
) -> None:
    driver = bypass.driver(watchdog=1.0)
    driver.open()
    driver.write({BALL: 1.0, THROTTLE: 0.5})
    for _ in range(10):
        bypass.clock.advance(0.5)
        assert driver.read()[BALL] in (0.5, 1.0)

    bypass.clock.advance(4.0)

    positions = bypass.device.valves.positions()
    assert positions["internal_leakage"][0] == 0.0
    assert positions["return_blockage"][1] == 0.0
    (trip,) = events(bypass, "bypass_watchdog_trip")
    assert trip["at_ns"] == bypass.clock.now_ns - 3_000_000_000
    with pytest.raises(DriverError, match=r"internal_leakage_ball.*has left 1 and stands at 0"):
        driver.read()


def test_another_device_at_the_address_is_refused(bypass: BypassBench) -> None:
    bypass.device.identity = 0x1234
    driver = bypass.driver()

    with pytest.raises(DriverError) as caught:
        driver.open()

    assert caught.value.channel == "identity"
    assert caught.value.state == f"127.0.0.1:{bypass.port} is 0x1234 and not 0x4256"
    with pytest.raises(DriverError, match="is not open"):
        driver.read()


def test_nobody_at_the_address_is_refused(bypass: BypassBench) -> None:
    bypass.power_off()

    with pytest.raises(DriverError, match=r"cannot connect to 127\.0\.0\.1:\d+; check power"):
        bypass.driver().open()


def test_a_refusal_of_the_device_names_the_valve_and_the_exception(bypass: BypassBench) -> None:
    driver = bypass.driver()
    driver.open()
    bypass.device.wire.exception = 4

    with pytest.raises(DriverError) as caught:
        driver.write({BALL: 1.0})

    assert caught.value.channel == BALL
    assert "refuses with Modbus exception 4" in caught.value.state
    assert not events(bypass, "ball_ordered")


@pytest.mark.parametrize("fault", ["replies_lost", "requests_lost", "garbage", "wrong_transaction"])
def test_a_device_without_a_valid_reply_is_lost_until_it_has_one_again(
    bypass: BypassBench, fault: str
) -> None:
    driver = bypass.driver(watchdog=0.0)
    driver.open()

    with bypass.unanswered(fault):
        for _ in range(4):
            with pytest.raises(DriverError) as caught:
                driver.read()
            # No channel: it is the device that is at fault, none of its valves.
            assert caught.value.channel == ""

    driver.safe_state()


def test_a_broken_connection_is_said_and_not_mended_behind_the_callers_back(
    bypass: BypassBench,
) -> None:
    driver = bypass.driver()
    driver.open()
    bypass.disconnect()

    for _ in range(2):
        with pytest.raises(DriverError, match=r"connection to .* is (broken|lost)"):
            driver.read()

    driver.close()
    driver.open()
    assert driver.read()[BALL] == 0.0


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"host": ""}, "`host` is missing"),
        ({"transport": "rtu"}, "`device` is missing"),
        ({"bypasses": ("internal",)}, "`bypasses` is internal, not some of external_leakage_1"),
        ({"bypasses": ()}, "`bypasses` is nothing"),
        ({"bypasses": ("supply_leakage",) * 2}, "each once"),
        ({"watchdog": 0.05}, "`watchdog` 0.05 s would strike between two readings at 20 Hz"),
        (
            {"transport": "rtu", "device": "/dev/ttyS0", "baud": 9600, "rate": 20.0},
            "`rate` 20 Hz is above 16.8 Hz, what 9600 baud pass",
        ),
    ],
)
def test_options_that_do_not_fit_together_are_refused(
    bypass: BypassBench, options: dict[str, Any], problem: str
) -> None:
    with pytest.raises(DriverError) as caught:
        bypass.driver(**options)

    assert problem in caught.value.state


def test_every_problem_of_the_options_is_said_at_once(bypass: BypassBench) -> None:
    with pytest.raises(DriverError, match=r"`host`.*`bypasses`.*`watchdog`"):
        bypass.driver(host="", bypasses=(), watchdog=0.01)
