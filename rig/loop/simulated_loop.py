"""The loop on the simulated backend, which runs compiled ticks in batches of any length."""

from dataclasses import KW_ONLY, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control import (
    COMMAND_LIMIT,
    PLAIN,
    POSITION_GAIN,
    Guide,
    LoopBasis,
    Steered,
    begin_motion,
    change_memory,
    changeable,
    control_memory,
    moving_guide,
    raised_cosine,
)
from estimator.accounts import BLOCK_TICKS
from estimator.filters import FilterMemory, FilterRun, compiled_filter
from rig.channels import READINGS
from rig.io import ChannelLimit, HomingSettings, SimulatedRig
from rig.loop.interlocks import (
    NO_CHANNEL,
    Action,
    Cause,
    Interlock,
    LoopStoppedError,
    PassingReader,
    RungPassed,
    channel_name,
    held_position,
    interlock,
    limit_table,
    tolerances,
    with_limits,
)
from rig.loop.wire import RAMP_S
from rig.plant import NO_FAULT, TICK, Parameters

from .cycle import READINGS_AT, Steering, Ticks, TrueRig, guard, row_channels, simulated_ticks
from .decided import no_decision
from .reaction import Reaction, reaction_memory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """The setpoints and faults of a test, tick by tick, and the start of its motion.

    Attributes:
        setpoint: float64 (ticks,), m in closed loop, V in open loop.
        open_loop: whether the setpoint is the valve command itself.
        faults: float64 (ticks, 8), coefficients (`rig.plant.faults.FAULT_COLUMNS`).
        start_position: position to which the ram is brought before the first tick, m.
        settle_ticks: number of ticks in which it is brought there.
    """

    setpoint: Array
    open_loop: bool
    faults: Array
    start_position: float
    settle_ticks: int


@dataclass(eq=False, repr=False)
class SimulatedLoop:
    """One test on a simulated rig, advanced any number of ticks at a time.

    Args:
        rig: the simulated rig, whose state the loop changes.
        motion: setpoint and faults of every tick.
        memory: the filter's memory, before its first sample.
        assumed: the parameters that the filter assumes.
        gain: gain of the position loop, V/m.
        limit: greatest command of either sign, V.
        on_fault: the reaction to a confirmed fault.
        interlock: judges every sample, as on hardware; if it is None, no sample is judged.
        limits: limits that hold while the test itself runs, and not on the way to its start.
        guide: what the position loop adds to gain times error.
        basis: what the tables of the move to the start are made from; None for a move without.

    Attributes:
        channels: names of the rows' columns (`row_channels`).

    Raises:
        ValueError: setpoint and fault table differ in length.
    """

    rig: SimulatedRig
    motion: Motion
    memory: FilterMemory
    assumed: Parameters
    _: KW_ONLY
    gain: float = POSITION_GAIN
    limit: float = COMMAND_LIMIT
    on_fault: Reaction = Reaction.IGNORE
    interlock: Interlock | None = None
    limits: tuple[ChannelLimit, ...] = ()
    guide: Guide = PLAIN
    basis: LoopBasis | None = None

    def __post_init__(self) -> None:
        motion, rig, assumed = self.motion, self.rig, self.assumed
        if motion.faults.shape != (motion.setpoint.size, len(NO_FAULT)):
            raise ValueError(
                f"fault table {motion.faults.shape} does not fit {motion.setpoint.size} setpoints"
            )
        self._held = np.zeros(1)
        self._laid = motion.setpoint
        self._tick = 0
        self._decided = no_decision()
        self._reaction = reaction_memory()
        self._control = control_memory()
        self._change = change_memory()
        self._before = self._steered()
        judged = self.interlock is not None
        self._guard = guard(self.interlock or _no_interlock(rig, assumed), judged)
        self._passings = PassingReader(self._guard.interlock.log)
        self.channels = row_channels(self.memory.filter.states, motion.open_loop)

    @property
    def ticks_left(self) -> int:
        """Number of ticks still to run.

        After a stop it is at least 1, so that the caller goes on to `advance`, which raises the
        stop.
        """
        left = self.motion.setpoint.size - self._tick
        return max(left, 1) if self._is_stopped else left

    @property
    def _is_stopped(self) -> bool:
        return bool(self._guard.stopped[0] >= Action.HOLD)

    @property
    def indicated(self) -> tuple[Cause, str]:
        """Cause and channel's name of the worst action so far; `Cause.NONE` and "" if none."""
        _, cause, channel = self._guard.stopped.tolist()
        return Cause(cause), channel_name(channel)

    @property
    def stopped(self) -> LoopStoppedError:
        """The error to raise for what stopped the loop: action, cause and channel."""
        return LoopStoppedError(Action(int(self._guard.stopped[0])), *self.indicated)

    def position(self) -> None:
        """Bring the ram to its start position by the position loop, along a raised cosine.

        Nothing is recorded. A copy of the filter runs, since the test's own filter must begin with
        the test.

        Raises:
            LoopStoppedError: the interlock stopped the motion.
        """
        rig = self.rig
        setpoint = raised_cosine(rig.state[4], self.motion.start_position, self.motion.settle_ticks)
        no_faults = np.tile(NO_FAULT, (setpoint.size, 1))
        guide = moving_guide(self.guide.law, self.basis, setpoint)
        rig.start_clock(-setpoint.size * TICK)
        self._run(setpoint, False, no_faults, guide, apart=True)
        begin_motion(True, self._control)
        rig.start_clock(0.0)
        if self._is_stopped:
            self._held[0] = 0.0
            raise self.stopped
        # What was passed on the way is not the test's.
        self._passings.take()

    def advance(self, ticks: int) -> Array:
        """Run up to `ticks` ticks and return their rows, float64 (n, columns of `channels`).

        There are fewer rows at the end of the test, or if the loop is stopped on the way.

        Raises:
            LoopStoppedError: the interlock stopped the loop, or a fault was confirmed and the test
                asks to trip then. Earlier calls have returned the rows up to the stop.
        """
        if self._is_stopped:
            raise self.stopped
        if self._tick == 0 and self.limits:
            judging = with_limits(self._guard.interlock, limit_table(self.limits, TICK))
            self._guard = self._guard._replace(interlock=judging)
        count = min(ticks, self.ticks_left)
        part = slice(self._tick, self._tick + count)
        motion = self.motion
        guide = self.guide.part(part)
        rows = self._run(motion.setpoint[part], motion.open_loop, motion.faults[part], guide)
        self._tick += len(rows)
        if self._is_stopped and not len(rows):
            raise self.stopped
        return rows

    def passed(self) -> list[RungPassed]:
        """Return the limits that were found passed since the last call."""
        return self._passings.take()

    def skip_to(self, place: int, blend_ticks: int) -> int | None:
        """Go on at a later place of the setpoints, as they were laid out.

        Args:
            place: index of that setpoint; their number to end the test.
            blend_ticks: number of ticks in which the setpoint goes over to those from there on,
                along a raised cosine.

        Returns:
            The tick of the test at which it goes on there; None if it was there already.
        """
        tick, motion = self._tick, self.motion
        rest = place - self._guard.lead
        if rest <= tick:
            return None
        laid = motion.setpoint[rest:]
        beside = 0.5 + 0.5 * np.cos(np.pi * np.arange(laid.size) / max(blend_ticks, 1))
        beside[blend_ticks:] = 0.0
        if laid.size:
            beside *= motion.setpoint[tick] - laid[0]
        setpoint = np.concatenate([motion.setpoint[:tick], laid + beside])
        self.motion = replace(motion, setpoint=setpoint)
        ahead, expected = self.guide.feedforward, self.guide.expected
        later = expected[rest:]
        # After a skip the setpoint is beside the one that is laid out, and so is the ram.
        later = later + beside[: later.size]
        self.guide = self.guide._replace(
            feedforward=np.concatenate([ahead[:tick], ahead[rest:]]),
            expected=np.concatenate([expected[:tick], later]),
        )
        self._guard = self._guard._replace(lead=self._guard.lead + rest - tick)
        return tick

    def change(self, gain: float, guide: Guide) -> int:
        """Give the running test another control; return the number of the tick from which it holds.

        Args:
            gain: gain of the position loop, V/m.
            guide: what the position loop adds to gain times error, for all setpoints as they were
                laid out.
        """
        self._before = self._steered()
        self.gain, self.guide = float(gain), changeable(self._skipped(guide))
        self._change.state[0] = 1.0
        return self._tick

    def _skipped(self, guide: Guide) -> Guide:
        """Return a guide for all setpoints without those that were skipped so far."""
        tick, lead = self._tick, self._guard.lead
        if not lead:
            return guide
        laid = self._laid[tick + lead :]
        beside = self.motion.setpoint[tick:] - laid
        expected = guide.expected[tick + lead :]
        gone = np.zeros(tick)
        return guide._replace(
            feedforward=np.concatenate([gone, guide.feedforward[tick + lead :]]),
            expected=np.concatenate([gone, expected + beside[: expected.size]]),
        )

    def _steered(self) -> Steered:
        """Return the present law with its feedforward at the next tick."""
        ahead, tick = self.guide.feedforward, self._tick
        now = float(ahead[tick]) if tick < ahead.size else 0.0
        return Steered(float(self.gain), self.guide.law, now, self.guide.tones)

    def stop(self, action: Action, cause: Cause) -> None:
        """Stop the loop for a cause that its own interlock does not judge; `advance` raises it."""
        self._guard.stopped[:] = int(action), int(cause), NO_CHANNEL

    def come_to_rest(self) -> Array:
        """Bring the command to 0 V along a ramp, after a stop that is no trip; return the rows.

        Injected faults do not act meanwhile. If the interlock trips on the way, the rows end there,
        and `stopped` is that trip.
        """
        left = 1.0 - np.arange(round(RAMP_S / TICK)) / round(RAMP_S / TICK)
        command = self._held[0]
        if self._guard.stopped[0] == Action.HOLD:
            # A hold begins with the command of the ram where it is, or well within its limits.
            position = self._guard.inputs[0]
            held = held_position(position, True, self._guard.interlock.limits)
            command = float(np.clip(self.gain * (held - position), -self.limit, self.limit))
        self._guard = self._guard._replace(ends_from=int(Action.TRIP))
        return self._run(command * left, True, np.tile(NO_FAULT, (left.size, 1)))

    def last_sample(self) -> Array:
        """Return a row, float64 (1, columns), of the sample that was judged last; the rest is NaN.

        Its time is one tick before 0, as it shows what stopped a ram on its way to the start
        position, which is not recorded.
        """
        row = np.full((1, len(self.channels)), np.nan)
        row[0, 0] = -TICK
        row[0, READINGS_AT : READINGS_AT + len(READINGS)] = self._guard.inputs[: len(READINGS)]
        return row

    def _run(
        self,
        setpoint: Array,
        open_loop: bool,
        faults: Array,
        guide: Guide = PLAIN,
        apart: bool = False,
    ) -> Array:
        """Run ticks until something ends them, and return their rows; see `simulated_ticks`.

        Ticks that are `apart` come before the test: they have noise, meters and a filter of their
        own, and the loop does not react to faults.
        """
        rig, memory, meters, on_fault = self.rig, self.memory, self.rig.meters, int(self.on_fault)
        if apart:
            memory, meters, on_fault = memory.copy(), meters.copy(), int(Reaction.IGNORE)
        noise = rig.noise_apart(setpoint.size) if apart else rig.noise(setpoint.size)
        rows = np.empty((setpoint.size, len(self.channels)))
        done = simulated_ticks(
            self._tick,
            Ticks(setpoint, faults, guide.feedforward, guide.expected, noise),
            Steering(
                open_loop, self.gain, self.limit, on_fault, guide.law, guide.tones, self._control,
                self._before, self._change,
            ),
            TrueRig(
                rig.state, rig.path, rig.seen, meters, rig.offsets, rig.fitted, self._held,
                rig.parameters, rig.sensors, rig.corrections,
            ),
            compiled_filter(memory, self.assumed),
            self._decided,
            self._reaction,
            self._guard,
            rows,
        )  # fmt: skip
        return rows[:done]

    def decided(self, row: Array) -> None:
        """Set the newest decision, a row of `DECIDED`, which all rows from now on contain."""
        self._decided = row

    def safe_state(self) -> None:
        """Bring the valve to null, and remove all faults from the rest of the test.

        The motion's table of faults is changed in place.
        """
        self._held[0] = 0.0
        self.motion.faults[self._tick :] = 0.0


def _no_interlock(rig: SimulatedRig, assumed: Parameters) -> Interlock:
    """Return an interlock without limits, for a loop that judges no sample."""
    judged = tolerances(assumed, rig.sensors, frozenset(), TICK, TICK, HomingSettings())
    return interlock(limit_table((), TICK), judged)


def estimates_in(rows: Array, channels: tuple[str, ...], memory: FilterMemory) -> FilterRun:
    """Return the filter's estimates in a batch of rows, in the form that a detector takes.

    Args:
        rows: float64 (n, channels), as a loop returns them.
        channels: names of the rows' columns.
        memory: the memory of the filter that made them.
    """
    outputs_at = channels.index("innovation_position_m")
    first = channels.index(f"est_{memory.filter.states[0]}")
    states, outputs = rows[:, first : first + len(memory.filter.states)], rows[:, outputs_at:first]
    return FilterRun(memory.filter, rows[:, 0], states, outputs, memory.dense_covariance)


def batch_ticks(first: bool) -> int:
    """Return the number of ticks of one batch: half a second, and one more if it is the first.

    Oil accounts run from sample to sample, so that the first block needs the sample before it.
    """
    return BLOCK_TICKS + 1 if first else BLOCK_TICKS
