"""What a campaign asks to be done about a confirmed fault is done, recorded and reported."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from control.setpoints import Sine
from estimator.filters.registry import FilterRun
from estimator.leaks.detection import Decision
from estimator.leaks.oil_account import Samples
from faults.campaign import Campaign, CampaignTest, OnFault
from faults.verdict import Verdict
from rig.configuration.rigs.rig import Rig
from rig.loop.interlocks.ladder import Cause
from rig.loop.reaction import Reaction
from rig.plant.integrator import TICK
from rig.recording import Recording, read_recording
from rig.runner import CampaignOutcome, Status, run_campaign

Array = NDArray[np.float64]
MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]
Run = Callable[..., tuple[CampaignOutcome, Recording]]

LEAK = 5e-9
ACTED_S = 1501 * TICK
"""Of the first tick after the third block, which ends at 1.5 s."""
HEALTHY = Decision("healthy")
LEAKING = Decision("external_leakage_1", present_leaks=(LEAK, 0.0, 0.0))


class Scripted:
    """A detector that decides as the test says, block by block; the last goes on."""

    def __init__(self, *script: Decision) -> None:
        self._script = list(script)

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take samples, and learn nothing of them."""

    def decide(self) -> Decision:
        return self._script.pop(0) if len(self._script) > 1 else self._script[0]


@pytest.fixture
def run(tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign) -> Run:
    """Run a test with a leak from 1 s on, found and lost again as a script says."""

    def run(on_fault: OnFault, *script: Decision, **changes: object) -> tuple:  # type: ignore[type-arg]
        test = leaking(duration_s=4.0, on_fault=on_fault, **changes)
        test = replace(test, faults=(replace(test.faults[0], at_s=1.0),))
        folder = tmp_path / on_fault
        campaign = make_campaign(test)
        outcome = run_campaign(campaign, rig, folder, detector=lambda model: Scripted(*script))
        return outcome, read_recording(folder / "external_leakage_1.mcap")

    return run


def told(recording: Recording) -> list[tuple[float, str]]:
    return [(event.time_s, event.text) for event in recording.events if event.kind == "on_fault"]


def proportional(recording: Recording) -> Array:
    gain = 50.0 * (recording["setpoint_m"] - recording["position_m"])
    return np.asarray(np.clip(gain, -10.0, 10.0))


def test_the_rigs_own_detector_confirms_a_leak_and_its_end(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    test = leaking(duration_s=36.0, on_fault=OnFault.TOLERATE)
    test = replace(test, faults=(replace(test.faults[0], at_s=12.0, until_s=24.0),))
    run_campaign(make_campaign(test), rig, tmp_path)
    recording = read_recording(tmp_path / "external_leakage_1.mcap")
    (begun_s, what), (ended_s, back) = told(recording)
    assert what.startswith("tolerating external_leakage_1 ")
    assert back == "back to proportional"
    assert 17.0 < begun_s < 21.0
    assert 24.0 < ended_s < 27.0
    later = recording.time_s > ended_s + 0.6
    assert np.array_equal(recording["command_V"][later], proportional(recording)[later])


def test_ignored_a_fault_changes_no_command(run: Run) -> None:
    outcome, ignored = run(OnFault.IGNORE, LEAKING)
    _, nothing = run(OnFault.TOLERATE, HEALTHY)
    assert np.array_equal(ignored["command_V"], nothing["command_V"])
    assert np.array_equal(ignored["position_m"], nothing["position_m"])
    assert np.array_equal(ignored["command_V"], proportional(ignored))
    assert told(ignored) == told(nothing) == []
    assert outcome.tests[0].actions == ()


def test_a_leak_is_tolerated_while_it_is_confirmed_and_no_longer(run: Run) -> None:
    # Blocks end at 0.5 s, 1.0 s, ...: confirmed by those at 1.5 s to 2.0 s.
    outcome, recording = run(OnFault.TOLERATE, HEALTHY, HEALTHY, LEAKING, LEAKING, HEALTHY)
    assert told(recording) == [
        (ACTED_S, "tolerating external_leakage_1 0.79 L/min"),
        (2501 * TICK, "back to proportional"),
    ]
    acts = recording["fault_action"] == Reaction.TOLERATE
    assert np.flatnonzero(acts).tolist() == list(range(1501, 2501))
    command, added = recording["command_V"], recording["compensation_V"]
    assert np.array_equal(command[:1501], proportional(recording)[:1501])
    assert (added[1501:2501] != 0.0).all()
    assert np.allclose(command - added, proportional(recording), atol=1e-12)
    # It goes within half a second, then the command is the proportional one to the bit.
    assert np.array_equal(command[3100:], proportional(recording)[3100:])
    (action,) = outcome.tests[0].actions
    assert (action.at_s, action.until_s) == (ACTED_S, 2501 * TICK)


@pytest.mark.parametrize("open_loop", [False, True])
def test_a_hold_freezes_the_ram_and_the_test_ends_as_ever(
    run: Run, open_loop: bool, tmp_path: Path
) -> None:
    changes = {"setpoint": Sine(0.0, 2.0, 0.5, 0.1, "command")} if open_loop else {}
    outcome, recording = run(OnFault.HOLD, HEALTHY, HEALTHY, LEAKING, HEALTHY, LEAKING, **changes)
    assert outcome.tests[0].status == Status.PASSED
    assert len(recording) == 4000
    held = recording["position_m"][1501]
    assert told(recording) == [(ACTED_S, "holding the ram")]
    assert (recording["fault_action"][1501:] == Reaction.HOLD).all()
    setpoint = recording["setpoint_V" if open_loop else "setpoint_m"][1501:]
    assert np.isnan(setpoint).all() if open_loop else (setpoint == held).all()
    assert np.ptp(recording["position_m"][2500:]) < 2e-3
    assert np.abs(recording["position_m"][2500:] - held).max() < 0.03
    found = json.loads((tmp_path / "hold" / "results.json").read_text())["tests"][0]["on_fault"]
    actions = [{"at_s": ACTED_S, "until_s": None, "what": "holding the ram"}]
    assert found == {"asked": "hold", "actions": actions}


def test_a_trip_ends_the_campaign_with_a_cause_of_its_own_and_a_report(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    campaign = make_campaign(leaking(duration_s=4.0, on_fault=OnFault.TRIP), make_test())
    outcome = run_campaign(
        campaign, rig, tmp_path, detector=lambda model: Scripted(HEALTHY, HEALTHY, LEAKING)
    )
    tripped, rest = outcome.tests
    assert (tripped.status, rest.status) == (Status.TRIPPED, Status.NOT_RUN)
    assert outcome.exit_code == 3
    assert tripped.decision is not None
    assert tripped.decision.verdict == Verdict.EXTERNAL_LEAKAGE_1
    report = json.loads((tmp_path / "trip-1.json").read_text())
    assert report["cause"] == Cause.FAULT_CONFIRMED.name
    assert report["notes"][0]["what"] == "external_leakage_1 confirmed"
    recording = read_recording(tmp_path / "external_leakage_1.mcap", required=("time_s",))
    assert recording.time_s[-1] == 1.5
    assert [event.kind for event in recording.events][-1] == "trip"
    assert str(tmp_path / "trip-1.json") in tripped.message


def test_what_is_done_about_a_fault_is_the_same_at_the_wall_clock(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    short = leaking(duration_s=1.3, settle_s=0.05, on_fault=OnFault.TOLERATE)
    recordings = []
    for pace in ("fast", "real"):
        run_campaign(
            make_campaign(short), rig, tmp_path / pace, pace=pace,
            detector=lambda model: Scripted(LEAKING),
        )  # fmt: skip
        recordings.append(read_recording(tmp_path / pace / "external_leakage_1.mcap"))
    fast, real = recordings
    assert (fast["compensation_V"][501:] != 0.0).all()
    assert fast.content_hash() == real.content_hash()
    assert fast.events == real.events
