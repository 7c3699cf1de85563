"""Runs tests on simulated rigs in this process, a new rig for each, and reports their trips."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np

from control import ControlSettings
from estimator.filters import FilterMemory
from faults import CampaignTest, FaultSchedule
from rig.channels import READINGS
from rig.configuration import Rig, gain_for
from rig.io import ChannelLimit, calibration_doubts, corrections_of, simulated_rig, today
from rig.loop import (
    Action,
    Cause,
    Interlock,
    LoopStoppedError,
    Motion,
    Reaction,
    RungPassed,
    SimulatedLoop,
    TripError,
    confirmed_fault,
    explain,
    interlock,
    limit_table,
    rungs_of,
)
from rig.plant import TICK, Model
from rig.recording import McapWriter, division_of
from rig.runner.leak_test import SimulatedLockable
from rig.runner.outcomes import Array
from rig.supervisor import (
    News,
    TripReport,
    basis_for,
    checks_for,
    guide_for,
    kept_trip_report,
    trip_error,
)

_REPORTED: Final = round(2.0 / TICK)
"""Number of rows in a trip report: those of the last 2 s, as on hardware."""


@dataclass
class SimulatedTest:
    """A `Loop` on a simulated rig, which reports a trip in the same way as a rig on hardware.

    Attributes:
        loop: the simulated loop, before its first tick.
        rig: the rig that is simulated.
        test: the test.
        assumed: the model that filter and loop assume.
        directory: folder of the run, to which a trip report is written.
        ladder: the limits of the loop's interlock, for a trip report: those of the rig come first.
        say: shows a line to the operator.
        of_test: how many of these limits are the test's.
        channels: names of the rows' columns.
    """

    loop: SimulatedLoop
    rig: Rig
    test: CampaignTest
    assumed: Model
    directory: Path
    ladder: Sequence[ChannelLimit]
    say: Callable[[str], None]
    of_test: int = 0

    def __post_init__(self) -> None:
        self.channels = self.loop.channels
        self._indicated = Cause.NONE, ""
        self._recent: list[Array] = []
        self._found = ""
        self._passed: list[RungPassed] = []
        self._told = 0
        self._limited: News | None = None

    @property
    def ticks_left(self) -> int:
        """Number of the test's ticks that have not been run yet."""
        return self.loop.ticks_left

    def position(self) -> None:
        """Move the ram to the test's start position, and wait until it has settled there.

        Raises:
            TripError: the interlock stopped the loop.
        """
        try:
            self.loop.position()
        except LoopStoppedError as error:
            self._recent = [self.loop.last_sample()]
            raise self._stopped(error) from None
        self._show_indicated()

    def inject(self) -> None:
        """Do nothing, as the loop has the faults in a table from its beginning."""

    def alive(self) -> None:
        """Do nothing, as a simulated rig waits for its runner."""

    def end_early(self) -> None:
        """Do nothing, as the next test has a rig of its own."""

    def latest(self, channel: str) -> float | None:
        """Return the newest value of a channel, in the channel's unit.

        The value is NaN if the rig has no such channel, and None before the first row.
        """
        if not self._recent:
            return None
        if channel not in self.channels:
            return float("nan")
        return float(self._recent[-1][-1, self.channels.index(channel)])

    def advance(self, ticks: int) -> Array:
        """Run the next `ticks` ticks, or all that are left, and return their rows, (n, columns).

        What the interlock indicates is shown to the operator.

        Raises:
            TripError: the interlock stopped the loop, or a fault was confirmed in a test that shall
                trip on a fault.
        """
        try:
            rows = self.loop.advance(ticks)
        except LoopStoppedError as error:
            raise self._stopped(error) from None
        self._keep(rows)
        self._show_indicated()
        return rows

    def change(self, control: ControlSettings) -> float:
        """Give the running test another control; return the time in s from which it holds."""
        setpoint = self.loop.motion.setpoint
        guide = guide_for(self.rig, self.test, setpoint, self.assumed, control)
        return self.loop.change(control.gain or self.rig.gain_V_per_m, guide) * TICK

    def decided(self, row: Array) -> None:
        """Give the loop the detector's decision, a row of `rig.loop.decided.DECIDED`."""
        self._found = confirmed_fault(row)
        self.loop.decided(row)

    def passed(self) -> list[RungPassed]:
        """Return the limits that the loop found passed in the test since the last call."""
        self._passed += self.loop.passed()
        told, self._told = self._told, len(self._passed)
        return self._passed[told:]

    def skip_to(self, place: int, blend_ticks: int) -> int | None:
        """Go on at a later place of the setpoints; see `SimulatedLoop.skip_to`."""
        return self.loop.skip_to(place, blend_ticks)

    def limited(self, action: Action, text: str) -> NoReturn:
        """Carry out the action of a limit that the loop itself does not judge.

        Raises:
            TripError: always.
        """
        self.say(text)
        self._limited = News(time.monotonic_ns(), "limit", text)
        self.loop.stop(action, Cause.TEST_LIMIT)
        raise self._stopped(self.loop.stopped)

    def safe_state(self) -> None:
        """Put the valve at null, and remove all injected faults."""
        self.loop.safe_state()

    def _keep(self, rows: Array) -> None:
        """Keep the newest rows, and of those before what a trip report may need."""
        if len(rows):
            self._recent.append(rows)
        while sum(map(len, self._recent[1:])) >= _REPORTED:
            del self._recent[0]

    def _show_indicated(self) -> None:
        """Show the operator what the interlock indicates, if anything, and if it is new."""
        indicated = self.loop.indicated
        if indicated not in ((Cause.NONE, ""), self._indicated):
            sentence, remedy = explain(*indicated)
            self.say(f"loop: {sentence}; {remedy}")
        self._indicated = indicated

    def _stopped(self, error: LoopStoppedError) -> TripError:
        """Make the rig safe after the loop has stopped, and return the error to raise.

        After a trip a trip report is written. After a lesser action the loop runs until the ram is
        at rest; then a report is written only if the loop trips meanwhile.
        """
        if error.action is not Action.TRIP:
            self._keep(self.loop.come_to_rest())
            if self.loop.stopped.action is not Action.TRIP:
                return TripError(str(error))
        self._passed += self.loop.passed()
        stopped = self.loop.stopped
        at_ns = time.monotonic_ns()
        self.loop.safe_state()
        safe_ns = time.monotonic_ns()
        found = [News(at_ns, "detector", self._found)] if self._found else []
        none = np.empty((0, len(self.channels)))
        report = TripReport(
            trips={"loop": (stopped.cause, at_ns)},
            confirmations=dict.fromkeys(("valve null", "bypass shut"), safe_ns),
            notes=[*([self._limited] if self._limited else []), *found],
            channels=self.channels,
            rows=np.concatenate([none, *self._recent])[-_REPORTED:],
            channel=stopped.channel,
            limits=self.ladder,
            of_test=self.of_test,
            passed=tuple(each for each in self._passed if each.rung < len(self.ladder)),
        )
        return trip_error(report, kept_trip_report(report, self.directory, self.say))


@dataclass
class SimulatedBench:
    """A `Bench` that simulates a new rig for each test.

    Attributes:
        rig: the rig to simulate.
        directory: folder of the run, to which a trip report is written.
        say: shows a line to the operator.
        live: False, as the runner must wait between batches to keep pace with the wall clock.
        test: the latest test; None before the first one and after `idle`.
    """

    rig: Rig
    directory: Path
    say: Callable[[str], None] = lambda line: None
    live: bool = field(default=False, init=False)
    test: SimulatedTest | None = field(default=None, init=False)

    def __enter__(self) -> "SimulatedBench":
        for doubt in calibration_doubts(self.rig.calibrations, today()):
            self.say(f"warning: {doubt}")
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def is_overdue(self) -> None:
        """Do nothing, as there is no rig that could be unsafe."""

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> SimulatedTest:
        """Return the loop of a test on a new simulated rig, which only this test uses."""
        loop = loop_of(self.rig, test, memory, assumed)
        own = rungs_of(test.limits)
        ladder = (*self.rig.ladder, *own)
        self.test = SimulatedTest(
            loop, self.rig, test, assumed, self.directory, ladder, self.say, len(own)
        )
        return self.test

    def lockable(self, test: CampaignTest) -> SimulatedLockable:
        """Return a new simulated rig that is to be locked, its ram at mid stroke."""
        self.test = None
        return SimulatedLockable(self.rig, test.seed)

    def reading(self, channel: str) -> float | None:
        """Return the newest value of a channel in the latest test, in the channel's unit.

        The value is NaN if the rig has no such channel, and None before the test's first row and
        after `idle`.
        """
        return None if self.test is None else self.test.latest(channel)

    def idle(self) -> None:
        """Forget the last test's rig, as there is no rig between two tests."""
        self.test = None

    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> McapWriter:
        """Return the writer of a test's new recording; the time of day is added to the metadata."""
        described = {**metadata, "start_ns": time.time_ns()}
        return McapWriter(path, channels, described, division_of(channels))


def interlock_of(
    rig: Rig, assumed: Model, fitted: frozenset[str] | None = None, period_s: float = TICK
) -> Interlock:
    """Return the interlock that judges the samples of a rig.

    Args:
        rig: the rig, with its limits.
        assumed: the model with which the samples must agree.
        fitted: channels of the transducers that the rig has; those of a simulated rig if not given.
        period_s: time from one sample to the next, s.
    """
    if fitted is None:
        has = {
            "spool_m": rig.has_spool_sensor,
            "supply_pressure_Pa": rig.has_supply_pressure_sensor,
            "load_N": rig.has_load_cell,
        }
        fitted = frozenset(name for name in READINGS if has.get(name, True))
    judged = checks_for(rig, assumed, fitted, period_s)
    return interlock(limit_table(rig.ladder, period_s), judged)


def loop_of(
    rig: Rig, test: CampaignTest, memory: FilterMemory, assumed: Model, *, judged: bool = True
) -> SimulatedLoop:
    """Return the simulated loop of a test, before the ram has moved to its start position.

    Args:
        rig: the rig to simulate.
        test: the test.
        memory: the filter's memory before its first sample.
        assumed: the model that filter and interlock assume.
        judged: whether the interlock judges the samples.
    """
    truth = rig.plant
    rest = 0.5 * (truth.parameters.stroke_min + truth.parameters.stroke_max)
    if test.load is not None:
        stiffness, contact = test.load.stiffness, test.load.contact
        truth = truth.with_effect("spring_load", stiffness=stiffness, contact=contact)
        # A stiff spring would throw a ram that begins inside it farther in a tick than any valve.
        rest = min(rest, contact)
    simulated = simulated_rig(
        truth,
        test.seed,
        sensors=rig.sensors,
        spool_sensor=rig.has_spool_sensor,
        supply_pressure_sensor=rig.has_supply_pressure_sensor,
        load_cell=rig.has_load_cell,
        position=rest,
    )
    simulated.corrections = corrections_of(rig.calibrations)
    ticks = round(test.duration_s / TICK)
    motion = Motion(
        setpoint=np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK)),
        open_loop=test.setpoint.quantity == "command",
        faults=FaultSchedule(test.faults).table(ticks, TICK),
        start_position=test.start_position_m,
        settle_ticks=round(test.settle_s / TICK),
    )
    return SimulatedLoop(
        simulated,
        motion,
        memory,
        assumed.parameters,
        gain=gain_for(rig, test),
        limit=rig.limits.command_V,
        on_fault=Reaction[test.on_fault.name],
        interlock=interlock_of(rig, assumed) if judged else None,
        guide=guide_for(rig, test, motion.setpoint, assumed),
        basis=basis_for(rig, test, assumed),
        limits=rungs_of(test.limits) if judged else (),
    )
