"""The commands of manual mode, as a person types them and as the page sends them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Final

from rig.configuration import Physical, QuantityError, suggestion

from .bounds import ManualError
from .generator import SHAPES

HELP: Final = """\
pump high | low | unloaded      load the pump and arm the valve; unload it and disarm the valve
home                            find the encoder's zero; nothing else moves the ram before
by 5mm [speed 20mm/s]           jog by a step, inwards with a minus sign
to 120mm [speed 20mm/s]         move to a position
hold out | in [speed 20mm/s]    hold-to-run: goes on while `beat` comes at least every 100 ms
beat                            the heartbeat of hold-to-run
stop                            bring the motion to rest; the ram is held there
generator sine mean 300mm amplitude 20mm frequency 0.5Hz
                                also triangle, trapezoid, steps; chirp with `upto 2Hz sweep 10s`
generator amplitude 40mm        change what runs, without a bump; also mean, frequency, upto, sweep
bypass internal_leakage open    open or shut the ball valve of a bypass
bypass internal_leakage 30%     opening of its needle valve
show                            position, pump, bypasses with their meters
help                            these lines
end                             make everything safe and leave"""
"""What can be typed."""

_QUANTITIES: Final = {
    "speed": "m/s",
    "mean": "m",
    "amplitude": "m",
    "frequency": "Hz",
    "upto": "Hz",
    "sweep": "s",
}
"""Words that a quantity follows, with its SI unit."""

PUMP: Final = ("unloaded", "low", "high")
DIRECTIONS: Final = {"out": 1.0, "in": -1.0}


@dataclass(frozen=True)
class Asked:
    """One command.

    Attributes:
        what: its first word.
        which: what it is about: a state of the pump, a direction, a shape or a bypass; else empty.
        value: its position, step or opening in SI units; None without one.
        ball: for a bypass, whether its ball is to be open; None if the needle is meant.
        numbers: its further quantities in SI units, by their words.
        beat_ms: the time of a heartbeat in ms on its sender's clock; None if it does not say.
    """

    what: str
    which: str = ""
    value: float | None = None
    ball: bool | None = None
    numbers: Mapping[str, float] = field(default_factory=dict)
    beat_ms: float | None = None


def parse(line: str) -> Asked:
    """Return the command in a line.

    Raises:
        ManualError: it is no command; the message says what is wrong and what can be written.
    """
    words = line.split()
    if not words:
        raise ManualError("nothing is asked for; `help` shows what can be")
    if words[0] not in _READ:
        remedy = suggestion(words[0], tuple(_READ), "commands")
        raise ManualError(f"{words[0]}: is no command; {remedy}")
    return _READ[words[0]](words)


def _alone(words: list[str]) -> Asked:
    _refuse_rest(words[0], words[1:])
    return Asked(words[0])


def _pump(words: list[str]) -> Asked:
    which = _one_of(words, PUMP)
    _refuse_rest("pump", words[2:])
    return Asked("pump", which)


def _moving(words: list[str]) -> Asked:
    if len(words) < 2:
        raise ManualError(f"{words[0]}: needs a length; write `{words[0]} 5mm`")
    value, rest = _quantity(words[0], words[1:], "m")
    return Asked(words[0], value=value, numbers=_numbers(words[0], rest, ("speed",)))


def _hold(words: list[str]) -> Asked:
    which = _one_of(words, tuple(DIRECTIONS))
    return Asked("hold", which, numbers=_numbers("hold", words[2:], ("speed",)))


def _beat(words: list[str]) -> Asked:
    if len(words) == 1:
        return Asked("beat")
    _refuse_rest("beat", words[2:])
    try:
        sent = float(words[1])
    except ValueError:
        sent = float("nan")
    if not isfinite(sent):
        raise ManualError(f"beat: {words[1]} is no time in ms; leave it out")
    return Asked("beat", beat_ms=sent)


def _generator(words: list[str]) -> Asked:
    named = len(words) > 1 and words[1] not in _QUANTITIES
    which = _one_of(words, tuple(SHAPES)) if named else ""
    known = ("mean", "amplitude", "frequency", "upto", "sweep")
    numbers = _numbers("generator", words[2 if named else 1 :], known)
    if not which and not numbers:
        raise ManualError("generator: nothing is asked for; write `generator amplitude 40mm`")
    return Asked("generator", which, numbers=numbers)


def _bypass(words: list[str]) -> Asked:
    if len(words) < 3:
        raise ManualError(
            "bypass: needs a bypass and open, shut or an opening; write "
            "`bypass internal_leakage open` or `bypass internal_leakage 30%`"
        )
    name, state = words[1], words[2]
    if state in ("open", "shut"):
        _refuse_rest("bypass", words[3:])
        return Asked("bypass", name, ball=state == "open")
    text = "".join(words[2:])
    try:
        opening = 0.01 * float(text.removesuffix("%")) if text.endswith("%") else float("nan")
    except ValueError:
        opening = float("nan")
    if not 0.0 <= opening <= 1.0:
        raise ManualError(f"bypass: {text} is no opening from 0% to 100%; write 30%, open or shut")
    return Asked("bypass", name, value=opening)


_READ: Final[Mapping[str, Callable[[list[str]], Asked]]] = {
    "pump": _pump,
    "home": _alone,
    "by": _moving,
    "to": _moving,
    "hold": _hold,
    "beat": _beat,
    "stop": _alone,
    "generator": _generator,
    "bypass": _bypass,
    "show": _alone,
    "help": _alone,
    "end": _alone,
}


def _one_of(words: list[str], known: tuple[str, ...]) -> str:
    if len(words) < 2 or words[1] not in known:
        given = words[1] if len(words) > 1 else "nothing"
        raise ManualError(f"{words[0]}: {given} is none of {', '.join(known)}; write one of them")
    return words[1]


def _numbers(what: str, words: list[str], known: tuple[str, ...]) -> dict[str, float]:
    found: dict[str, float] = {}
    while words:
        name = words[0]
        if name not in known:
            raise ManualError(f"{what}: {name} is none of {', '.join(known)}; write one of them")
        if name in found:
            raise ManualError(f"{what}: {name} is there twice; keep one")
        if len(words) < 2:
            raise ManualError(f"{what}: {name} has no value; write it with its unit")
        found[name], words = _quantity(f"{what} {name}", words[1:], _QUANTITIES[name])
    return found


def _quantity(what: str, words: list[str], unit: str) -> tuple[float, list[str]]:
    """Return the quantity with which words begin, and the words after it.

    Its unit may be a word of its own, and a sign may stand before it.
    Raise `ManualError` if it is no such quantity.
    """
    is_apart = len(words) > 1 and words[0][-1].isdigit() and words[1] not in _QUANTITIES
    used = 2 if is_apart else 1
    text = " ".join(words[:used])
    try:
        return float(Physical(unit, float("-inf"), float("inf")).parse(text)), words[used:]
    except QuantityError as error:
        raise ManualError(f"{what}: {text} {error}") from None


def _refuse_rest(what: str, rest: list[str]) -> None:
    if rest:
        raise ManualError(f"{what}: {' '.join(rest)} is too much; leave it out")
