"""Finds the signs and the null of a rig that was just armed, by small motions in open loop."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from faults import Verdict
from rig.io import Wiring
from rig.plant import TICK, Model
from rig.supervisor import BrokenOffError, UnprovenRig

from .operator import Operator
from .signs import Answers, Pair, answers_of, encoder_by_sides, pair_commands, pair_of, wiring_of

Array = NDArray[np.float64]

AMPLITUDES: Final = (0.15, 0.3)
"""Commands in V to either side by which the ram is first asked to answer, from the smallest on; the
last is the homing section's command. By 0.065 m/(s V) the first moves it by 4 mm to either side."""
FIRST_S: Final = 0.4
"""Duration in s of each of the first commands: ten times the lag of valve and oil."""
_REFINED_V: Final = 0.2
_REFINED_S: Final = 0.6
"""Amplitude and duration of the pairs that tell null: some 8 mm to either side."""
_REFINEMENTS: Final = 2
_AWAY_V: Final = 0.3
_AWAY_S: Final = 0.8
_AWAY_M: Final = 5e-3
_AWAYS: Final = 3
"""Command, duration and least way by which the ram comes off a stop, and how many such commands are
given: they lead to some 50 mm from the stop, as the commands that follow move it by up to 20 mm."""
_SIDES_S: Final = 0.8
SIDE_LEAK: Final = 3.2e-9
"""Coefficient in m^3/(s Pa^0.5) of the leak by which the sides are told apart. It makes 0.5 L/min
at 6.9 MPa, as much as a command of 0.2 V lets through; the ways with the one and with the other
bypass come out some 20 mm apart."""
_SIDES: Final = (str(Verdict.EXTERNAL_LEAKAGE_1), str(Verdict.EXTERNAL_LEAKAGE_2))


class NotFoundError(Exception):
    """Raised when what all further steps need cannot be found; the message has the remedy."""


@dataclass(frozen=True)
class Signs:
    """What the small motions showed.

    Attributes:
        wiring: how the rig is wired, against the wiring that its file tells.
        null_V: command at which the ram stands, in the sign of that wiring, V.
        answers: which channels answered to the command.
        sided_by: what told the two sides of the cylinder apart, in words; empty if nothing did, so
            that the file is taken at its word, with which all channels agree.
        pair: the last pair of commands.
        rows: (ticks, 5), the rows of the first commands, as `rig.supervisor.PROBED`.
    """

    wiring: Wiring
    null_V: float  # noqa: N815
    answers: Answers
    sided_by: str
    pair: Pair
    rows: Array


class Probing:
    """Finds the signs of a rig that is armed, with its command at 0 V.

    Args:
        rig: the rig.
        assumed: the model; only the travel of its spool for a volt is used.
        greatest_V: greatest null, V, with which a run may go on.
        operator: is asked which way the rod moved.
        say: shows a line to the operator.
    """

    def __init__(
        self,
        rig: UnprovenRig,
        assumed: Model,
        greatest_V: float,  # noqa: N803
        operator: Operator,
        say: Callable[[str], None],
    ) -> None:
        self._rig = rig
        self._valve_gain = assumed.parameters.valve_gain
        self._greatest_V = greatest_V
        self._operator = operator
        self._say = say
        self._gain = 0.0
        self._rows = np.empty((0, 5))

    def run(self) -> Signs:
        """Return the signs and the null.

        Raises:
            NotFoundError: the ram does not answer to the command, it answers in two ways, null is
                beyond what a run allows, or the sides of the cylinder cannot be told apart.
            TripError: the rig tripped or was stopped.
        """
        pair = self._answering()
        first = self._rows
        for _ in range(_REFINEMENTS):
            null = min(max(pair.null_V, -self._greatest_V), self._greatest_V)
            pair = self._pair(null, _REFINED_V, _REFINED_S)
            if not pair.answers:
                raise NotFoundError(
                    f"the ram answered to the first commands and not to {_REFINED_V:g} V about "
                    f"{null:.2f} V: look for air, a sticking valve or a slipping encoder"
                )
        if abs(pair.null_V) > self._greatest_V:
            raise NotFoundError(
                f"the valve's null is at {pair.null_V:.2f} V, and a run allows "
                f"{self._greatest_V:.2f} V: adjust the valve's null, and begin again"
            )
        answers = answers_of(pair, self._valve_gain)
        # From here on the loop may be closed: valve and encoder agree with this sign of the gain.
        self._gain = answers.encoder * self._rig.configured.gain_V_per_m
        self._rig.hold(self._gain)
        encoder, sided_by = self._sides(pair.null_V, answers)
        wiring = wiring_of(answers, encoder)
        null = -pair.null_V if wiring.valve == "inverted" else pair.null_V
        return Signs(wiring, null, answers, sided_by, pair, first)

    def _answering(self) -> Pair:
        """Return the first pair to which the ram answers, about 0 V."""
        homing = self._rig.configured.homing
        assert homing is not None
        for amplitude in sorted({*AMPLITUDES, homing.command}):
            self._say(f"small commands of {amplitude:g} V to either side")
            pair = self._pair(0.0, amplitude, FIRST_S)
            if pair.answers:
                return pair
        raise NotFoundError(
            f"the ram does not answer to commands of {homing.command:g} V: check the supply "
            "pressure, the valve's plug and amplifier, and whether the encoder counts"
        )

    def _pair(self, centre: float, amplitude: float, seconds: float) -> Pair:
        """Return what a pair of commands makes; from a stop, the ram is moved off it first."""
        commands = pair_commands(centre, amplitude, seconds)
        for tries in range(2):
            try:
                self._rows = self._rig.play(commands, self._gain)
            except BrokenOffError as error:
                if tries:
                    raise _stuck(error) from error
            else:
                pair = pair_of(self._rows, centre, amplitude)
                if not pair.blocked or tries:
                    return pair
            self._come_off(centre)
        raise AssertionError

    def _come_off(self, centre: float) -> None:
        """Move the ram off what it stands at, whichever way it can go.

        Raises:
            NotFoundError: it can go neither way.
        """
        last: Exception | None = None
        for way in (-1.0, 1.0):
            commands = np.full(round(_AWAY_S / TICK), centre + way * _AWAY_V)
            try:
                rows = self._rig.play(commands, self._gain)
            except BrokenOffError as error:
                last = error
                continue
            if abs(_way_of(rows)) >= _AWAY_M:
                with suppress(BrokenOffError):
                    for _ in range(_AWAYS - 1):
                        self._rig.play(commands, self._gain)
                self._say("the ram stood at a stop, and was moved off it")
                return
        raise _stuck(last) from last

    def _sides(self, null: float, answers: Answers) -> tuple[int, str]:
        """Return the encoder's own sign, 1 or -1, and what told it, in words."""
        told = {}
        by_valves = self._by_bypasses(null)
        if by_valves:
            told["the bypass valves"] = by_valves
        by_eye = self._by_eye(null)
        if by_eye:
            told["the operator"] = by_eye
        if len(set(told.values())) > 1:
            raise NotFoundError(
                "the bypass valves say that the encoder counts "
                f"{'up' if by_valves > 0 else 'down'} while the rod comes out, and the operator "
                "saw the opposite: check that the bypass of chamber 1 is on chamber 1, and look "
                "again"
            )
        if told:
            return by_valves or by_eye, " and ".join(told)
        if answers.encoder > 0 and answers.load_pressure >= 0 and answers.spool >= 0:
            return 1, ""
        raise NotFoundError(
            "the channels contradict each other, and nothing tells which are right: valve with "
            f"encoder {_agrees(answers.encoder)}, valve with pressures "
            f"{_agrees(answers.load_pressure)}; run the command in a terminal, and look which way "
            "the rod moves, or fit the bypasses of both chambers"
        )

    def _by_bypasses(self, null: float) -> int:
        """Return the encoder's own sign by a leak of either chamber; 0 if that does not tell."""
        rig = self._rig
        if not set(_SIDES) <= set(rig.configured.injectable):
            return 0
        for factor in (1.0, 4.0):
            ways = []
            self._say("the sides of the cylinder, by a small leak from either chamber")
            openings = {}
            for kind in _SIDES:
                valve = rig.configured.bypass_valves[kind]
                leak = max(factor * SIDE_LEAK, valve.minimum)
                openings[f"{kind}_needle"] = valve.needle_opening_for(leak)
            rig.set_valves(openings)
            for kind in _SIDES:
                rig.set_valves({f"{kind}_ball": 1.0})
                ways.append(self._way(pair_commands(null, _REFINED_V, _SIDES_S), null))
                rig.set_valves({f"{kind}_ball": 0.0})
            rig.set_valves(dict.fromkeys(openings, 0.0))
            found = encoder_by_sides(*ways)
            if found:
                return found
        return 0

    def _by_eye(self, null: float) -> int:
        """Return the encoder's own sign by what the operator saw; 0 if he did not see it."""
        if not self._operator.sees:
            return 0
        self._say("watch the rod: it moves one way by one or two centimetres")
        way = self._way(np.full(round(_AWAY_S / TICK), null + _AWAY_V), null)
        return self._operator.way(self._rig.check) * int(np.sign(way))

    def _way(self, commands: Array, null: float) -> float:
        """Return the way in m by the encoder from the begin to the end of commands.

        Of a ram that meets a stop, the commands are repeated after it was moved off.
        """
        try:
            return _way_of(self._rig.play(commands, self._gain))
        except BrokenOffError:
            self._come_off(null)
        try:
            return _way_of(self._rig.play(commands, self._gain))
        except BrokenOffError as error:
            raise _stuck(error) from error


def _way_of(rows: Array) -> float:
    known = rows[np.isfinite(rows[:, 1]), 1]
    return float(known[-1] - known[0]) if known.size else float("nan")


def _agrees(sign: int) -> str:
    return {1: "agrees", -1: "disagrees", 0: "does not tell"}[sign]


def _stuck(error: Exception | None) -> NotFoundError:
    return NotFoundError(
        f"{error or 'the ram does not come off where it stands'}: bring the ram about the middle "
        "of its stroke by hand, see that nothing is in its way, and begin again"
    )
