"""Defines the pieces of a session's code; each is run on tiny inputs so that numba compiles it.

What numba compiles depends on the types of the arguments, not on their values, so that any model
and any test will do.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba.core.types import literal

from control import (
    PLAIN,
    Constant,
    ControlSettings,
    Moment,
    Steered,
    change_memory,
    changeable,
    control_memory,
    expected_position,
    offset_of_change,
)
from estimator.accounts import compile_fits, compile_ramp_search
from estimator.filters import (
    DEFAULT_FILTER,
    OUTPUTS,
    FilterRun,
    compiled_filter,
    moving_average_absolute,
    run_filter,
    start_memory,
)
from estimator.friction import load_lag
from estimator.intermittent import compile_openings
from estimator.leaks import Samples, detector_for
from rig.configuration import Rig
from rig.io import DriverSpec, simulated_rig
from rig.loop import (
    Board,
    Drive,
    Reaction,
    Segment,
    control_in,
    course,
    guard,
    judge,
    no_decision,
    pace,
    post_decision,
    react,
    reaction_memory,
    sample_row,
    tolerating,
    wire_channels,
    wire_memory,
    wire_ticks,
)
from rig.plant import (
    NO_FAULT,
    READING_COUNT,
    SUBSTEPS,
    TICK,
    Model,
    compile_part,
    drive,
    follow,
    read_sensors,
)

from .bench import plain_test
from .simulated_bench import interlock_of, loop_of

_JUDGED_S: Final = 12.0
"""Time over which the detector judges: long enough that it compares faults with each other, s."""
_NEVER: Final = -1
"""Number of a segment that the loop never switches to: the loop returns at once."""


@dataclass(frozen=True)
class Needs:
    """The rig and the filter of a session, on which it depends how functions are compiled.

    Attributes:
        rig: the rig of the session.
        filter_name: name of the filter that the loop runs.
    """

    rig: Rig
    filter_name: str

    @property
    def fast(self) -> DriverSpec:
        """The driver with which the loop exchanges samples; a rig on hardware has just one."""
        (fast,) = (spec for spec in self.rig.drivers if spec.kind == "fast")
        return fast


def _plant(needs: Needs) -> None:
    """Compile a tick of a simulated rig."""
    simulated = simulated_rig(Model(), 0, sensors=needs.rig.sensors)
    par, state, seen = simulated.parameters, simulated.state, simulated.seen
    flows, fault = (0.0, 0.0, 0.0), tuple(NO_FAULT)
    compile_part(drive, state, simulated.path, 0.0, par, fault, literal(SUBSTEPS))
    follow(seen, state, par)
    read_sensors(
        state, seen, flows, 0.0, simulated.meters, simulated.offsets, np.zeros(READING_COUNT), par,
        simulated.sensors, np.zeros(READING_COUNT),
    )  # fmt: skip


def _interlock(needs: Needs) -> None:
    """Compile how a simulated loop judges a sample."""
    watching = guard(interlock_of(needs.rig, Model()), True)
    compile_part(judge, np.zeros(READING_COUNT), 0.0, 0.0, 0, watching)


def _reaction(needs: Needs) -> None:
    """Compile how a simulated loop reacts to a decision."""
    reaction, decided = reaction_memory(), no_decision()
    react(int(Reaction.IGNORE), decided, 0.0, reaction)
    estimated = start_memory(needs.filter_name, Model(), needs.rig.sensors).x
    tolerating(
        0.0, int(Reaction.IGNORE), decided, estimated, Model().parameters, 0.0, 0.0, reaction
    )


def _change(needs: Needs) -> None:
    """Compile how a loop goes over to another control, and with it the tracking law."""
    law = Steered(1.0, changeable(PLAIN).law, 0.0, PLAIN.tones)
    moment = Moment(0.0, 0.0, 0.0, 1.0, TICK)
    offset_of_change(moment, law, law, control_memory(), change_memory())


def _estimates(needs: Needs) -> None:
    """Compile the filter's step, and how a loop writes its row."""
    memory = start_memory(needs.filter_name, Model(), needs.rig.sensors)
    compile_part(
        sample_row, True, (0.0, 0.0, 0.0), 0.0, np.zeros(READING_COUNT),
        compiled_filter(memory, Model().parameters), no_decision(), reaction_memory().acted,
        np.zeros(1),
    )  # fmt: skip


def _simulated_loop(needs: Needs) -> None:
    """Compile the loop of a simulated rig, by two ticks of it: the first only starts the filter."""
    memory = start_memory(needs.filter_name, Model(), needs.rig.sensors)
    # It is not judged, so that no limit ends it before it has run.
    standing = plain_test("compiled", Constant(0.3), 2 * TICK, 0.3, TICK)
    loop = loop_of(needs.rig, standing, memory, Model(), judged=False)
    loop.position()
    loop.advance(2)


def _expected(needs: Needs) -> None:
    """Compile where a ram should be, by which the integral part of the tracking law goes."""
    par, settings = Model().parameters, ControlSettings(integral_time=1.0)
    expected_position(np.zeros(2), settings, par, needs.rig.gain_V_per_m, 1.0)


def _filter(needs: Needs) -> None:
    """Compile the run of the session's filter, and for the default one its lag of load."""
    samples, _ = _swinging(needs, 2)
    measured = np.column_stack(
        [samples.position, samples.pressure_1, samples.pressure_2, samples.spool]
    )
    run_filter(
        samples.time_s, samples.command, measured, Model(), needs.filter_name, needs.rig.sensors
    )
    if needs.filter_name == DEFAULT_FILTER:
        load_lag(Model(), needs.rig.sensors)


def _detector(needs: Needs) -> None:
    """Compile the detector, by letting it judge a swinging ram, and the average of the reports."""
    detector = detector_for(needs.filter_name, Model(), 1.0)
    detector.update(*_swinging(needs, round(_JUDGED_S / TICK)))
    detector.decide()
    compile_fits()
    compile_ramp_search()
    compile_openings()
    moving_average_absolute(np.zeros(1))


def _decisions(needs: Needs) -> None:
    """Compile how a decision is posted to the loop."""
    board = Board.create(1)
    post_decision(board, 0, no_decision())
    os.close(board.fd)


def _loop(needs: Needs) -> None:
    """Compile the loop for hardware, by a call that returns before its first tick.

    No device is connected.
    """
    rig, model = needs.rig, Model()
    memory = start_memory(needs.filter_name, model, rig.sensors)
    fast = needs.fast
    driver = fast.create_fast()
    board = Board.create(len(wire_channels(memory.filter.states, open_loop=False)))
    nothing = course(Segment(_NEVER, Drive.NULL, memory, model.parameters))
    wire_ticks(
        nothing,
        control_in(nothing),
        compiled_filter(memory, model.parameters),
        interlock_of(rig, model, frozenset(fast.inputs), 1.0 / rig.loop.rate),
        pace(rig.loop, driver.rate_hz),
        -1,
        driver.plan(),
        driver.look_plan(),
        wire_memory(),
        board,
    )  # fmt: skip
    os.close(board.fd)


def _swinging(needs: Needs, ticks: int) -> tuple[Samples, FilterRun]:
    """Return samples and estimates of a ram that swings about mid stroke at up to 0.45 m/s.

    Valve flow and motion agree roughly, so that a detector has something to compare.
    """
    par = Model().parameters
    random = np.random.default_rng(0)
    time_s = np.asarray(np.arange(ticks) * TICK, np.float64)
    phase = 3.0 * time_s
    position = 0.5 * (par.stroke_min + par.stroke_max) + 0.15 * np.sin(phase)
    spool = 0.5 * par.valve_gain * np.cos(phase)
    pressure = 0.5 * par.supply_pressure + 1e5 * random.standard_normal((2, ticks))
    supply = np.full(ticks, par.supply_pressure)
    samples = Samples(
        time_s, spool / par.valve_gain, position, pressure[0], pressure[1], spool, supply
    )
    memory = start_memory(needs.filter_name, Model(), needs.rig.sensors)
    states = np.zeros((ticks, memory.x.size))
    for name, values in (
        ("position_m", position),
        ("pressure_1_Pa", pressure[0]),
        ("pressure_2_Pa", pressure[1]),
        ("spool_m", spool),
    ):
        states[:, memory.filter.states.index(name)] = values
    outputs = random.standard_normal((ticks, len(OUTPUTS)))
    run = FilterRun(memory.filter, time_s, states, outputs, memory.dense_covariance)
    return samples, run


@dataclass(frozen=True)
class Piece:
    """A part of a session's code that one process compiles at a time.

    Attributes:
        run: runs the code on tiny inputs, or only compiles it for their types.
        after: names of the pieces whose code it contains; they are compiled before it, and reused.
    """

    run: Callable[[Needs], None]
    after: tuple[str, ...] = ()


LOOP: Final = "loop"
"""The piece that contains the exchange of the fast driver. A session's loop process loads it itself
before it reports that it is ready."""
PIECES: Final[dict[str, Piece]] = {
    "plant": Piece(_plant),
    "estimates": Piece(_estimates),
    "interlock": Piece(_interlock),
    "reaction": Piece(_reaction),
    "change of control": Piece(_change),
    "simulated loop": Piece(
        _simulated_loop, after=("plant", "estimates", "interlock", "reaction", "change of control")
    ),
    "expected position": Piece(_expected),
    "filter": Piece(_filter, after=("estimates",)),
    "detector": Piece(_detector),
    "decisions": Piece(_decisions),
    LOOP: Piece(_loop, after=("filter", "change of control")),
}
"""All pieces, by the names that the operator reads."""
