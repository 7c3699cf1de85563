"""A simulated rig is stopped by the interlock as one on hardware is, by the same causes."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from control.setpoints import Sine
from estimator.filters.registry import start_memory
from faults.campaign import Campaign, CampaignTest, SpringLoad
from faults.schedule import Fault
from faults.verdict import Verdict
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.rigs.limits import usual_ladder
from rig.configuration.rigs.rig import Rig
from rig.io.limits import ChannelLimit, Response
from rig.io.simulated import SimulatedRig, simulated_rig
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.trip import LoopStoppedError
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.plant import NO_FAULT, Model
from rig.plant.integrator import TICK
from rig.recording import read_recording
from rig.recording.formats.mcap_reader import read_mcap
from rig.runner import Observer, Status, run_campaign
from rig.runner.campaign.simulated_bench import interlock_of, loop_of

Array = NDArray[np.float64]
MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]
Spoil = Callable[[SimulatedRig], None]

SOUND_TICKS = 2000
TICKS = 6000
TIME = np.arange(TICKS) * TICK
SINE = 0.3 + 0.2 * np.sin(np.pi * TIME)
REST = np.full(TICKS, 0.3)
SHIPPED = sorted((Path(__file__).parents[4] / "config/campaigns").glob("*.yaml"))


def true(**changes: float) -> Spoil:
    """Return what changes the truth of a simulated rig."""

    def spoil(rig: SimulatedRig) -> None:
        rig.parameters = rig.parameters._replace(**changes)

    return spoil


def unplugged(channel: int) -> Spoil:
    return lambda rig: rig.fitted.__setitem__(channel, np.nan)


def freezes(rig: SimulatedRig) -> None:
    """Give the encoder counts so long that it stays at the one where it is."""
    rig.sensors = rig.sensors._replace(position_resolution=rig.state[4])


def jumps(rig: SimulatedRig) -> None:
    rig.state[4] += 0.02


JUDGED: dict[Cause, list[tuple[str, Action, Array, Spoil]]] = {
    Cause.SENSOR_NAN: [
        ("position_m", Action.TRIP, SINE, unplugged(0)),
        ("pressure_1_Pa", Action.TRIP, SINE, unplugged(1)),
        ("pressure_2_Pa", Action.TRIP, REST, unplugged(2)),
        ("spool_m", Action.RAMP_DOWN, SINE, unplugged(3)),
        ("supply_pressure_Pa", Action.RAMP_DOWN, REST, unplugged(4)),
        ("load_N", Action.RAMP_DOWN, SINE, unplugged(5)),
    ],
    Cause.SENSOR_RANGE: [
        ("pressure_1_Pa", Action.TRIP, REST, true(pressure_1_bias=2e7)),
        ("pressure_2_Pa", Action.TRIP, REST, true(pressure_2_bias=2e7)),
    ],
    Cause.SENSOR_FROZEN: [("pressure_1_Pa", Action.TRIP, REST, true(pressure_1_bias=-2e7))],
    Cause.ENCODER_FROZEN: [("position_m", Action.TRIP, SINE, freezes)],
    Cause.ENCODER_JUMP: [("position_m", Action.TRIP, SINE, jumps)],
    Cause.POSITION_AGAINST_FLOW: [("position_m", Action.TRIP, SINE, true(piston_area=3e-4))],
    Cause.PRESSURE_ABOVE_SUPPLY: [
        ("pressure_1_Pa", Action.TRIP, REST, true(pressure_1_bias=1.3e7)),
        ("pressure_2_Pa", Action.TRIP, REST, true(pressure_2_bias=1.15e7)),
    ],
    Cause.PRESSURES_CROSSED: [("pressure_1_Pa", Action.TRIP, SINE, true(pressure_1_bias=-6e6))],
    Cause.SPOOL_NOT_FOLLOWING: [("spool_m", Action.TRIP, SINE, true(valve_rate_limit=1e-6))],
}
"""By cause: the channel concerned, the action, the motion, and what goes wrong in it."""
CASES = [
    pytest.param(cause, *case, id=f"{cause.name} {case[0]}")
    for cause, cases in JUDGED.items()
    for case in cases
]


def judged_loop(rig: Rig, setpoint: Array) -> tuple[SimulatedRig, SimulatedLoop]:
    """Return a simulated rig and its loop, judged as `rig` is."""
    simulated = simulated_rig(Model(), 7, sensors=rig.sensors)
    motion = Motion(setpoint, False, np.tile(NO_FAULT, (setpoint.size, 1)), setpoint[0], 500)
    loop = SimulatedLoop(
        simulated, motion, start_memory("product", Model(), rig.sensors), Model().parameters,
        interlock=interlock_of(rig, Model()),
    )  # fmt: skip
    return simulated, loop


def stopped(loop: SimulatedLoop) -> tuple[LoopStoppedError, Array]:
    """Run a loop until it is stopped; return why, and the last rows."""
    rows = np.empty((0, len(loop.channels)))
    while loop.ticks_left:
        try:
            rows = loop.advance(500)
        except LoopStoppedError as error:
            return error, rows
    pytest.fail("nothing stopped it")


@pytest.mark.parametrize(("cause", "channel", "action", "motion", "spoil"), CASES)
def test_what_goes_wrong_on_a_simulated_rig_stops_it_by_name(
    rig: Rig, cause: Cause, channel: str, action: Action, motion: Array, spoil: Spoil
) -> None:
    simulated, loop = judged_loop(rig, motion)
    loop.position()
    loop.advance(SOUND_TICKS)
    spoil(simulated)
    error, rows = stopped(loop)
    assert (error.cause, error.channel, error.action) == (cause, channel, action)
    if action is Action.TRIP:
        # From the sample on that trips, the valve is at null.
        assert rows[-1, 2] == 0.0


def test_every_cause_that_a_simulated_sample_can_show_was_among_them() -> None:
    of_a_device = {
        Cause.STALE_SAMPLE, Cause.ENCODER_FAULT, Cause.DEVICE_STOPPED, Cause.DEVICE_DEAF,
        Cause.COMMAND_ECHO,
        Cause.FOREIGN_MASTER,
    }  # fmt: skip
    of_limits = {Cause.LIMIT_LOW, Cause.LIMIT_HIGH}
    of_samples = {cause for cause in Cause if Cause.NONE < cause < Cause.ESTOP_OPEN}
    assert of_samples - of_a_device - of_limits == set(JUDGED)


def test_a_loop_without_interlock_goes_on_whatever_happens(rig: Rig) -> None:
    simulated = simulated_rig(Model(), 7, sensors=rig.sensors)
    motion = Motion(SINE, False, np.tile(NO_FAULT, (TICKS, 1)), 0.3, 500)
    memory = start_memory("product", Model(), rig.sensors)
    loop = SimulatedLoop(simulated, motion, memory, Model().parameters)
    simulated.fitted[1] = np.nan
    loop.position()
    assert len(loop.advance(TICKS)) == TICKS


def test_a_ram_that_comes_to_rest_without_a_trip_is_left_at_null(rig: Rig) -> None:
    simulated, loop = judged_loop(rig, SINE)
    loop.position()
    loop.advance(SOUND_TICKS)
    simulated.fitted[5] = np.nan
    stopped(loop)
    loop.come_to_rest()
    # The spool is at null once the command is, and the ram's own friction has stopped it.
    assert abs(simulated.state[0]) < 1e-6
    assert abs(simulated.state[5]) < 1e-3


class Listening(Observer):
    """Keeps what the operator is shown."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def rig_tells(self, text: str) -> None:
        self.told.append(text)


@pytest.fixture
def limited(rig: Rig) -> Callable[..., Rig]:
    """Return a rig with the limits that every rig file has, and further rungs."""

    def limited(*rungs: ChannelLimit) -> Rig:
        usual = usual_ladder(rig.limits, rig.plant.parameters)
        return replace(rig, ladder=(*usual, *rungs))

    return limited


def rung(channel: str, action: Response = "trip", **limits: float) -> ChannelLimit:
    return ChannelLimit(channel, action=action, for_s=3e-3, **limits)


def volts(command: float) -> Sine:
    """Return an almost constant command: the ram goes to its stroke's end."""
    return Sine(command, 0.01, 0.5, 0.0, "command")


MIDDLE_M = 0.5 * Model().parameters.stroke_max
FROM_REST: dict[str, Any] = {
    "start_position_m": MIDDLE_M,
    "setpoint": Sine(MIDDLE_M, 0.2, 0.5, 0.0, "position"),
}
"""The ram need not be moved to where it begins, so that it trips in the test."""

LEAKING: dict[str, Any] = {"faults": (Fault(Verdict.EXTERNAL_LEAKAGE_1, 2e-8, at_s=2.0),)}

TRIPS: dict[str, tuple[tuple[ChannelLimit, ...], dict[str, Any], str, str]] = {
    "over-travel outwards": ((), {"setpoint": volts(9.0)}, "LIMIT_HIGH", "position_m"),
    "over-travel inwards": ((), {"setpoint": volts(-9.0)}, "LIMIT_LOW", "position_m"),
    "over-pressure in chamber 1": (
        (rung("pressure_1_Pa", high=8e6),), FROM_REST, "LIMIT_HIGH", "pressure_1_Pa"
    ),
    "over-pressure in chamber 2": (
        (rung("pressure_2_Pa", high=8e6),), FROM_REST, "LIMIT_HIGH", "pressure_2_Pa"
    ),
    "a leak, by its meter": (
        (rung("flow_1_m3_per_s", high=1e-5),), LEAKING, "LIMIT_HIGH", "flow_1_m3_per_s"
    ),
    "over-speed, by the spool that makes it": (
        (rung("spool_m", high=5e-5),), FROM_REST, "LIMIT_HIGH", "spool_m"
    ),
    "force": (
        (rung("load_N", high=2e3),), {"load": SpringLoad(2e4, 0.3)}, "LIMIT_HIGH", "load_N"
    ),
}  # fmt: skip
"""Further limits, changes of the test, and the cause and channel of the trip."""


@pytest.mark.parametrize("name", TRIPS)
def test_a_campaign_that_exceeds_a_limit_ends_as_on_hardware(
    name: str, tmp_path: Path, limited: Callable[..., Rig], make_test: MakeTest,
    make_campaign: MakeCampaign,
) -> None:  # fmt: skip
    rungs, changes, cause, channel = TRIPS[name]
    rig = limited(*rungs)
    campaign = make_campaign(make_test(**changes), make_test("rest"))
    outcome = run_campaign(campaign, rig, tmp_path)
    tripped, rest = outcome.tests
    assert outcome.exit_code == 3
    assert (tripped.status, rest.status) == (Status.TRIPPED, Status.NOT_RUN)
    report = json.loads((tmp_path / "trip-1.json").read_text())
    assert (report["by"], report["cause"], report["channel"]) == ("loop", cause, channel)
    assert [step["what"] for step in report["confirmations"]] == ["valve null", "bypass shut"]
    assert all(step["after_s"] >= 0.0 for step in report["confirmations"])
    beyond = report["value"] - report["limit"]
    assert beyond > 0.0 if cause == "LIMIT_HIGH" else beyond < 0.0
    assert tripped.message.startswith(report["sentence"])
    assert str(tmp_path / "trip-1.json") in tripped.message
    # Whatever its length: some trip within the second that a replay needs.
    recording = read_mcap(str(tmp_path / "healthy.mcap"))
    assert 0 < len(recording) < round(14.0 / TICK)
    assert recording.events[-1].kind == "trip"
    assert np.isfinite(recording.columns[channel][-1])


def test_a_trip_is_run_again_when_the_campaign_is_resumed_and_its_data_are_kept(
    tmp_path: Path, limited: Callable[..., Rig], make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    rig = limited(rung("flow_1_m3_per_s", high=1e-5))
    campaign = make_campaign(make_test(**LEAKING), make_test("rest"))
    run_campaign(campaign, rig, tmp_path)
    first = read_recording(tmp_path / "healthy.mcap")
    outcome = run_campaign(campaign, rig, tmp_path, resume=True)
    assert outcome.exit_code == 3
    assert (tmp_path / "trip-2.json").is_file()
    kept = read_recording(tmp_path / "healthy~1.mcap")
    assert kept.content_hash() == first.content_hash()
    # The same seed, the same noise: it trips at the same sample.
    assert read_recording(tmp_path / "healthy.mcap").content_hash() == first.content_hash()


def test_a_hold_ends_the_test_and_the_ram_stays_within_what_trips(
    tmp_path: Path, limited: Callable[..., Rig], make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    # Slow enough to be brought to rest before the limit that trips.
    test = make_test(setpoint=volts(0.5), start_position_m=0.585)
    campaign = make_campaign(test)
    outcome = run_campaign(campaign, limited(), tmp_path)
    (held,) = outcome.tests
    assert (held.status, outcome.exit_code) == (Status.TRIPPED, 3)
    assert held.message.startswith("hold: position_m is above its limit")
    assert not (tmp_path / "trip-1.json").exists()


def test_what_is_only_indicated_is_reported_once_and_the_test_goes_on(
    tmp_path: Path, limited: Callable[..., Rig], make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    listening = Listening()
    rig = limited(rung("pressure_1_Pa", "indicate", high=8e6))
    outcome = run_campaign(make_campaign(make_test()), rig, tmp_path, observer=listening)
    assert outcome.tests[0].status is Status.PASSED
    assert len(listening.told) == 1
    assert listening.told[0].startswith("loop: pressure_1_Pa is above its limit")


def test_a_rig_that_is_not_what_the_campaign_takes_it_for_trips_before_its_test(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    truth = Model().parameters._replace(piston_area=3e-4)
    wrong = replace(rig, plant=replace(Model(), parameters=truth))
    outcome = run_campaign(make_campaign(make_test(start_position_m=0.5)), wrong, tmp_path)
    assert outcome.tests[0].status is Status.TRIPPED
    report = json.loads((tmp_path / "trip-1.json").read_text())
    assert report["cause"] == Cause.POSITION_AGAINST_FLOW.name


def test_a_limit_is_kept_on_the_way_to_the_start_too_and_the_report_has_the_value(
    tmp_path: Path, limited: Callable[..., Rig], make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    rig = limited(rung("supply_pressure_Pa", low=13.9e6))
    outcome = run_campaign(make_campaign(make_test()), rig, tmp_path)
    assert (outcome.tests[0].status, outcome.exit_code) == (Status.TRIPPED, 3)
    report = json.loads((tmp_path / "trip-1.json").read_text())
    assert (report["cause"], report["channel"]) == ("LIMIT_LOW", "supply_pressure_Pa")
    assert 13e6 < report["value"] < 13.9e6
    assert not list(tmp_path.glob("*.mcap"))


def test_limits_change_nothing_of_a_run_that_keeps_them(
    tmp_path: Path, rig: Rig, limited: Callable[..., Rig], make_test: MakeTest,
    make_campaign: MakeCampaign,
) -> None:  # fmt: skip
    campaign = make_campaign(make_test(duration_s=3.0))
    hashes = set()
    for name, judged in (("without", rig), ("with", limited(rung("load_N", high=2e4)))):
        run_campaign(campaign, judged, tmp_path / name)
        hashes.add(read_recording(tmp_path / name / "healthy.mcap").content_hash())
    assert len(hashes) == 1


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_no_test_of_a_shipped_campaign_trips_on_its_way_to_the_start_or_in_its_first_second(
    path: Path,
) -> None:
    campaign, rig = load_campaign(path)
    for test in campaign.tests:
        memory = start_memory("product", campaign.model, rig.sensors)
        loop = loop_of(rig, test, memory, campaign.model)
        loop.position()
        loop.advance(1000)
        assert loop.indicated == (Cause.NONE, ""), test.name
