import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from junitparser import Error, Failure, JUnitXml, Skipped

from estimator.filters.registry import FilterRun
from estimator.leaks.detection import Decision, Detector
from estimator.leaks.oil_account import Samples
from faults.campaign import Campaign, CampaignTest, SpringLoad
from faults.verdict import Verdict
from rig.configuration.rigs.rig import Rig
from rig.loop.interlocks.trip import StopRequestedError
from rig.loop.simulated_loop import SimulatedLoop
from rig.plant import Model
from rig.recording import McapWriter, read_recording
from rig.runner import CampaignOutcome, DirectoryError, Observer, Status, StopFlag, run_campaign
from rig.runner.run_folder import write_results

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


class Interfering(Observer):
    """Does something when a test has come to a time."""

    def __init__(self, at_s: float, action: Callable[[], None]) -> None:
        self._at_s = at_s
        self._action = action

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        if time_s >= self._at_s:
            self._action()


class Constant:
    """A detector that always says the same, or crashes when it has seen enough."""

    def __init__(self, verdict: str = "healthy", crash_at_s: float = 1e9) -> None:
        self._verdict = verdict
        self._crash_at_s = crash_at_s

    def update(self, samples: Samples, run: FilterRun) -> None:
        if samples.time_s[-1] >= self._crash_at_s:
            raise ZeroDivisionError("the detector divides by zero")

    def decide(self) -> Decision:
        return Decision(self._verdict)


@pytest.fixture
def made_safe(monkeypatch: pytest.MonkeyPatch) -> list[SimulatedLoop]:
    """Collect the loops whose valve was put at null, in order."""
    safe: list[SimulatedLoop] = []
    original = SimulatedLoop.safe_state

    def noted(loop: SimulatedLoop) -> None:
        safe.append(loop)
        original(loop)

    monkeypatch.setattr(SimulatedLoop, "safe_state", noted)
    return safe


def results_in(directory: Path) -> dict[str, list[dict[str, object]]]:
    content: dict[str, list[dict[str, object]]] = json.loads(
        (directory / "results.json").read_text()
    )
    return content


def crashing_once(at_s: float) -> Callable[[Model], Detector]:
    """Make a detector for each test, of which the first crashes."""
    left = [at_s]
    return lambda model: Constant(crash_at_s=left.pop() if left else 1e9)


def test_a_leak_is_found_named_and_measured_and_a_healthy_rig_passes(
    tmp_path: Path, rig: Rig, make_test: MakeTest, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    outcome = run_campaign(make_campaign(make_test(), leaking()), rig, tmp_path)
    healthy, leak = outcome.tests
    assert [healthy.status, leak.status] == [Status.PASSED, Status.PASSED]
    assert outcome.exit_code == 0
    assert leak.onset_error_s == pytest.approx(0.0, abs=0.5)
    assert leak.leak_error_m3_per_s == pytest.approx(0.0, abs=0.03 / 6e4)
    assert leak.latency_s is not None
    assert leak.latency_s > 0.0
    assert healthy.latency_s is None
    assert healthy.onset_error_s is None


def test_writing_the_results_takes_a_small_part_of_the_time_however_many_tests_there_are(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    written: list[list[Status]] = []

    def slowly(outcome: CampaignOutcome, path: Path) -> None:
        written.append([test.status for test in outcome.tests])
        write_results(outcome, path)

    monkeypatch.setattr("rig.runner.campaign.campaign_run.write_results", slowly)
    monkeypatch.setattr("rig.runner.campaign.campaign_run._WRITE_EVERY_S", -1.0)
    # What takes a millisecond now may be done again in some minutes.
    monkeypatch.setattr("rig.runner.campaign.campaign_run._WRITE_PART", 1e-6)
    tests = [make_test(name, duration_s=1.0) for name in ("a", "b", "c")]
    run_campaign(make_campaign(*tests), rig, tmp_path, detector=lambda model: Constant())
    assert written == [[Status.NOT_RUN] * 3, [Status.PASSED] * 3]


def test_a_leak_where_health_was_expected_fails_the_test(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    outcome = run_campaign(make_campaign(leaking(expect=Verdict.HEALTHY)), rig, tmp_path)
    assert outcome.tests[0].status == Status.FAILED
    assert outcome.exit_code == 1
    case = next(iter(next(iter(JUnitXml.fromfile(str(tmp_path / "junit.xml"))))))
    assert isinstance(case.result[0], Failure)
    assert "injected external_leakage_1" in case.result[0].message


def test_the_folder_holds_results_junit_and_a_readable_recording_a_test(
    tmp_path: Path, rig: Rig, make_test: MakeTest, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    run_campaign(make_campaign(make_test("a/b"), leaking()), rig, tmp_path)
    names = {file.name for file in tmp_path.iterdir()}
    written = {"journal.jsonl", "results.json", "junit.xml"}
    assert names == written | {"a_b.mcap", "external_leakage_1.mcap"}
    recording = read_recording(tmp_path / "external_leakage_1.mcap")
    assert len(recording) == 14000
    verdicts = [event.text for event in recording.events if event.kind == "verdict"]
    others = [event.kind for event in recording.events if event.kind != "verdict"]
    assert others == ["test_begin", "fault_on", "test_end"]
    assert verdicts[0] == "inconclusive"
    assert verdicts[-1] == "external_leakage_1"


def test_at_the_wall_clock_a_test_is_the_same_bit_for_bit(
    tmp_path: Path, rig: Rig, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    short = leaking(duration_s=1.2, settle_s=0.05)
    recordings = []
    for pace in ("fast", "real"):
        run_campaign(make_campaign(short), rig, tmp_path / pace, pace=pace)
        recordings.append(read_recording(tmp_path / pace / "external_leakage_1.mcap"))
    fast, real = recordings
    assert fast.content_hash() == real.content_hash()
    assert fast.events == real.events


def test_the_same_seed_gives_the_same_recording_and_another_seed_another(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    seeds = {"a": 1, "b": 1, "c": 2}
    tests = [make_test(name, duration_s=1.0, seed=seed) for name, seed in seeds.items()]
    run_campaign(make_campaign(*tests), rig, tmp_path)
    a, b, c = (read_recording(tmp_path / f"{name}.mcap").content_hash() for name in seeds)
    assert a == b != c


def test_a_crash_in_a_detector_is_an_error_of_its_test_and_the_others_go_on(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    made_safe: list[SimulatedLoop],
) -> None:
    campaign = make_campaign(make_test("first"), make_test("second"))
    outcome = run_campaign(campaign, rig, tmp_path, detector=crashing_once(at_s=3.0))
    first, second = outcome.tests
    assert [first.status, second.status] == [Status.ERROR, Status.PASSED]
    assert "ZeroDivisionError: the detector divides by zero" in first.message
    assert outcome.exit_code == 1
    assert "in update" in (tmp_path / "errors.log").read_text()
    case = next(iter(next(iter(JUnitXml.fromfile(str(tmp_path / "junit.xml"))))))
    assert isinstance(case.result[0], Error)
    assert len(set(made_safe)) == 2
    recording = read_recording(tmp_path / "first.mcap")
    assert 3.0 <= recording.time_s[-1] < 4.0
    assert recording.events[-1].kind == "error"


@pytest.mark.parametrize("crash_at_s", [3.0, 1e9])
def test_the_valve_is_at_null_before_the_recording_is_closed(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    monkeypatch: pytest.MonkeyPatch,
    crash_at_s: float,
) -> None:
    order: list[str] = []
    safe_state, close = SimulatedLoop.safe_state, McapWriter.close

    def put_at_null(loop: SimulatedLoop) -> None:
        order.append("valve")
        safe_state(loop)

    def close_recording(writer: McapWriter) -> None:
        order.append("recording")
        close(writer)

    monkeypatch.setattr(SimulatedLoop, "safe_state", put_at_null)
    monkeypatch.setattr(McapWriter, "close", close_recording)
    campaign = make_campaign(make_test(duration_s=4.0))
    run_campaign(campaign, rig, tmp_path, detector=crashing_once(crash_at_s))
    assert order[:2] == ["valve", "recording"]


def test_a_recording_shows_the_rig_s_own_transducers_and_the_test_s_load(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    coarse = replace(
        rig,
        sensors=rig.sensors._replace(position_resolution=1e-3, load_noise=0.0),
        has_supply_pressure_sensor=False,
    )
    campaign = make_campaign(make_test(load=SpringLoad(2e4, 0.25), duration_s=4.0))
    run_campaign(campaign, coarse, tmp_path)
    recording = read_recording(tmp_path / "healthy.mcap")
    millimetres = recording["position_m"] * 1e3
    np.testing.assert_allclose(millimetres, np.round(millimetres), atol=1e-9)
    assert np.isnan(recording["supply_pressure_Pa"]).all()
    spring = 2e4 * np.maximum(recording["true_position_m"] - 0.25, 0.0)
    np.testing.assert_allclose(recording["load_N"], spring, atol=1e-6)


def test_the_position_loop_has_the_rig_s_own_gain_and_command_limit(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    weak = replace(rig, gain_V_per_m=30.0, limits=replace(rig.limits, command_V=2.0))
    run_campaign(make_campaign(make_test(duration_s=4.0)), weak, tmp_path)
    recording = read_recording(tmp_path / "healthy.mcap")
    asked = 30.0 * (recording["setpoint_m"] - recording["position_m"])
    np.testing.assert_allclose(recording["command_V"], np.clip(asked, -2.0, 2.0), atol=1e-12)
    assert np.abs(asked).max() > 2.0


def test_a_stop_while_the_ram_is_positioned_is_no_trip(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stop = StopFlag()

    def position(_: SimulatedLoop) -> None:
        stop.request("the operator")
        raise StopRequestedError("stopped by the operator")

    monkeypatch.setattr(SimulatedLoop, "position", position)
    (only,) = run_campaign(make_campaign(make_test()), rig, tmp_path, stop=stop).tests
    assert (only.status, only.message) == (Status.ABORTED, "stopped by the operator")


def test_a_stop_aborts_the_test_keeps_what_there_is_and_leaves_the_rest(
    tmp_path: Path,
    rig: Rig,
    leaking: MakeTest,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    made_safe: list[SimulatedLoop],
) -> None:
    stop = StopFlag()
    observer = Interfering(5.0, lambda: stop.request("the operator"))
    campaign = make_campaign(leaking(), make_test("second"))
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer, stop=stop)
    first, second = outcome.tests
    assert [first.status, second.status] == [Status.ABORTED, Status.NOT_RUN]
    assert first.message == "stopped by the operator"
    assert first.injected == ()  # its leak was due later
    assert outcome.exit_code == 3
    recording = read_recording(tmp_path / "external_leakage_1.mcap")
    assert recording.time_s[-1] == pytest.approx(5.0)
    assert recording.events[-1].kind == "abort"
    assert made_safe
    written = results_in(tmp_path)
    assert [test["status"] for test in written["tests"]] == ["aborted", "not_run"]
    cases = list(next(iter(JUnitXml.fromfile(str(tmp_path / "junit.xml")))))
    assert isinstance(cases[1].result[0], Skipped)


def test_a_stop_while_the_ram_is_brought_to_its_start_leaves_no_recording(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    stop = StopFlag()

    class AtOnce(Observer):
        def test_begins(self, number: int, test: CampaignTest) -> None:
            stop.request("the operator")

    campaign = make_campaign(make_test())
    outcome = run_campaign(campaign, rig, tmp_path, observer=AtOnce(), stop=stop)
    assert outcome.tests[0].status == Status.ABORTED
    assert outcome.tests[0].recording is None
    assert not list(tmp_path.glob("*.mcap"))


def test_a_stop_at_the_last_sample_of_a_test_still_judges_it(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    stop = StopFlag()
    observer = Interfering(13.99, lambda: stop.request("the operator"))
    campaign = make_campaign(make_test(), make_test("second"))
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer, stop=stop)
    assert [test.status for test in outcome.tests] == [Status.PASSED, Status.NOT_RUN]


def test_an_interrupt_without_a_handler_aborts_as_a_stop_does(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    campaign = make_campaign(make_test(), make_test("second"))
    outcome = run_campaign(campaign, rig, tmp_path, observer=Interfering(5.0, interrupt))
    assert [test.status for test in outcome.tests] == [Status.ABORTED, Status.NOT_RUN]
    assert read_recording(tmp_path / "healthy.mcap").time_s[-1] == pytest.approx(5.0)


def test_a_program_that_exits_in_a_test_leaves_valve_recording_and_results_in_order(
    tmp_path: Path,
    rig: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    made_safe: list[SimulatedLoop],
) -> None:
    def leave() -> None:
        raise SystemExit(9)

    with pytest.raises(SystemExit):
        run_campaign(make_campaign(make_test()), rig, tmp_path, observer=Interfering(5.0, leave))
    assert made_safe
    assert read_recording(tmp_path / "healthy.mcap").time_s[-1] == pytest.approx(5.0)
    assert [test["status"] for test in results_in(tmp_path)["tests"]] == ["not_run"]


def test_while_it_runs_the_folder_is_known_for_a_run_s(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    seen: list[object] = []
    observer = Interfering(5.0, lambda: seen.append(results_in(tmp_path)["schema"]))
    run_campaign(make_campaign(make_test()), rig, tmp_path, observer=observer)
    assert set(seen) == {"rig-results"}


def test_an_earlier_run_is_replaced_with_all_its_recordings(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    for name in ("earlier", "later"):
        campaign = make_campaign(make_test(name, duration_s=1.0))
        run_campaign(campaign, rig, tmp_path, detector=lambda model: Constant())
    assert {file.name for file in tmp_path.glob("*.mcap")} == {"later.mcap"}


def test_a_folder_that_is_no_run_s_is_left_alone(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(DirectoryError, match=r"thesis\.txt"):
        run_campaign(make_campaign(make_test()), rig, tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_detector_of_one_s_own_judges_every_test(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    campaign = make_campaign(make_test(duration_s=1.0, expect=Verdict.MULTIPLE))
    outcome = run_campaign(campaign, rig, tmp_path, detector=lambda model: Constant("multiple"))
    assert outcome.tests[0].status == Status.PASSED
    assert outcome.tests[0].detected_at_s == pytest.approx(0.5)


@pytest.mark.long
def test_healthy_tests_run_first_where_the_thesis_s_detector_learns_from_them(
    tmp_path: Path, rig: Rig, make_test: MakeTest, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    begun: list[str] = []

    class Noting(Observer):
        def test_begins(self, number: int, test: CampaignTest) -> None:
            begun.append(test.name)

    campaign = make_campaign(leaking(), make_test(duration_s=20.0), filter_name="thesis-6")
    outcome = run_campaign(campaign, rig, tmp_path, observer=Noting())
    assert begun == ["healthy", "external_leakage_1"]
    leak, healthy = outcome.tests
    assert leak.thresholds_from == "healthy tests: healthy"
    assert healthy.thresholds_from == "first 15 s of the test"
    assert leak.decision is not None
    assert leak.decision.verdict != "inconclusive"  # 14 s are too short to learn from
