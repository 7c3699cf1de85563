"""Checks of what every driver has to do, which any driver can be run through (docs/drivers.md).

A check takes a factory that makes a specimen: a driver together with a device of its own. The check
raises `NonconformityError` if the driver does not behave as `rig.io.driver.Driver` says, or if a
fast driver does not behave as `FastDriver` says. The checks need no test framework.
"""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, is_dataclass
from functools import wraps
from math import isfinite, isinf, isnan, nan
from typing import Any, Final

import numpy as np
from numba import typeof
from numba.core.errors import NumbaError
from numba.extending import is_jitted
from numpy.typing import NDArray

from rig.jit import njit

from .driver import Driver, DriverError, ExchangeStatus, FastDriver, Plan
from .loop_exchange import exchange
from .signals import FAST_INPUTS, FAST_OUTPUTS, SLOW_INPUTS, SLOW_OUTPUTS

PATIENCE_S: Final = 20.0
"""Longest time in s that a call of a driver may take.

It is a thousand times what most calls take, so that a busy machine fails no check.
"""

_READINGS: Final = 200
"""Number of readings, at the driver's rate, within which an expected effect must show."""

_NO_SIGNAL: Final = "no_such_signal"

_NAMES: Final = {
    "fast": (FAST_INPUTS, FAST_OUTPUTS),
    "slow": (SLOW_INPUTS, SLOW_OUTPUTS),
}


class NonconformityError(AssertionError):
    """Raised when a driver does not do what every driver has to do."""


@dataclass(frozen=True)
class Specimen:
    """A driver that is to be checked, with a device that serves this driver alone.

    Attributes:
        driver: the driver, not yet open; its device is connected and in its safe state.
        unplug: disconnects the device for good.
        standing: returns the present values of the device's outputs, in any form that can be
            compared.
        is_safe: returns whether the device's outputs are in their safe state.
        moves: output values by signal that bring the device out of its safe state; empty for a
            device without outputs.
        wait: waits for a time that is given in s.
    """

    driver: Driver
    unplug: Callable[[], object]
    standing: Callable[[], object] = lambda: None
    is_safe: Callable[[], bool] = lambda: True
    moves: Mapping[str, float] = field(default_factory=dict)
    wait: Callable[[float], None] = time.sleep


Factory = Callable[[], AbstractContextManager[Specimen]]
"""Makes a context manager that yields a specimen, and removes it when the check is over."""

Check = Callable[[Factory], None]

_CHECKS: Final[list[Check]] = []


def _check(body: Callable[[Specimen, Driver], None]) -> Check:
    """Return a check that makes a specimen and has `body` judge it; add the check to `CHECKS`."""

    @wraps(body)
    def check(factory: Factory) -> None:
        with factory() as specimen:
            body(specimen, specimen.driver)

    _CHECKS.append(check)
    return check


@_check
def check_declaration(specimen: Specimen, driver: Driver) -> None:
    """Check that name, kind, options, signals and rate are declared and valid for a rig."""
    _require(isinstance(driver, Driver), "lacks part of the protocol rig.io.driver.Driver")
    _require(is_dataclass(driver.Options), "has Options that are no dataclass")
    _require(driver.kind in _NAMES, f"is of kind {driver.kind!r}, neither fast nor slow")
    if driver.kind == "fast":
        fast = isinstance(driver, FastDriver)
        _require(fast, "is fast, and lacks part of the protocol rig.io.driver.FastDriver")
    known_inputs, known_outputs = _NAMES[driver.kind]
    for what, names, known in (
        ("inputs", driver.inputs, known_inputs),
        ("outputs", driver.outputs, known_outputs),
    ):
        unknown = sorted(set(names) - set(known))
        _require(not unknown, f"has {what} that no {driver.kind} driver has: {unknown}")
        _require(len(set(names)) == len(names), f"has the same twice among its {what}")
    rate = driver.rate_hz
    _require(isfinite(rate) and rate > 0.0, f"has the rate {rate} Hz")


@_check
def check_open_and_close(specimen: Specimen, driver: Driver) -> None:
    """Check that repeated open and close do no harm, and that a closed driver can be reopened."""
    driver.close()
    for _ in range(2):
        driver.open()
        driver.open()
        driver.read()
        driver.close()
        driver.close()


@_check
def check_not_open(specimen: Specimen, driver: Driver) -> None:
    """Check that a driver that is not open, or is closed again, refuses to read and to write.

    Only a driver with `moves` is asked to write, and the device must stay in its safe state.
    """
    for when in ("before it is open", "after it is closed"):
        _refusal(driver, f"reads {when}", driver.read)
        if specimen.moves:
            _refusal(driver, f"writes {when}", driver.write, specimen.moves)
        driver.open()
        driver.close()
    _require(specimen.is_safe(), "moves something though it is not open")


@_check
def check_open_moves_nothing(specimen: Specimen, driver: Driver) -> None:
    """Check that opening, reading and closing change no output of the device."""
    before = specimen.standing()
    driver.open()
    for _ in range(3):
        specimen.wait(1.0 / driver.rate_hz)
        driver.read()
    driver.close()
    after = specimen.standing()
    _require(after == before, f"moves something before the first write: {before} to {after}")


@_check
def check_readings(specimen: Specimen, driver: Driver) -> None:
    """Check that all declared inputs and no others are read, as floats that are finite or NaN."""
    driver.open()
    found: dict[str, float] = {}
    for _ in range(_READINGS):
        for signal, value in driver.read().items():
            _require(signal in driver.inputs, f"reads {signal}, which it does not declare")
            _require(isinstance(value, float), f"reads {signal} as {type(value).__name__}")
            _require(not isinf(value), f"reads {signal} as {value}")
            found[signal] = value
        if len(found) == len(driver.inputs):
            return
        specimen.wait(1.0 / driver.rate_hz)
    lacking = [signal for signal in driver.inputs if signal not in found]
    _require(False, f"never reads {', '.join(lacking)}")


@_check
def check_bad_outputs(specimen: Specimen, driver: Driver) -> None:
    """Check that an unknown output or a NaN is refused by an error that names it, and not sent."""
    driver.open()
    before = specimen.standing()
    for signal, value in {_NO_SIGNAL: 1.0, **dict.fromkeys(driver.outputs, nan)}.items():
        outputs = {**specimen.moves, signal: value}
        error = _refusal(driver, f"writes {signal} = {value}", driver.write, outputs)
        named = signal in error.channel
        _require(named, f"refuses {signal} = {value} without naming it: {error}")
    after = specimen.standing()
    _require(after == before, f"obeys a write that it refuses: {before} to {after}")


@_check
def check_safe_state(specimen: Specimen, driver: Driver) -> None:
    """Check that `safe_state` works before open, after open, after a move, twice, after close."""
    _safe(specimen, "before it is open")
    driver.close()
    driver.open()
    _safe(specimen, "before the first write")
    _safe(specimen, "again")
    driver.close()
    driver.open()
    driver.write(specimen.moves)
    _require(_leaves_safety(specimen), "does not leave its safe state by the moves given")
    _safe(specimen, "after a move")
    driver.close()
    _safe(specimen, "after it is closed")


@_check
def check_vanished_device(specimen: Specimen, driver: Driver) -> None:
    """Check that a vanished device is noticed, by an error if it has outputs, and no call hangs."""
    driver.open()
    driver.write(specimen.moves)
    specimen.unplug()
    _require(_notices(specimen), "does not notice that its device is gone")
    if driver.outputs:
        _refusal(driver, "calls itself safe without its device", driver.safe_state)
    else:
        _bounded("safe_state", driver.safe_state)
    for _ in range(2):
        _bounded("close", driver.close)


@_check
def check_absent_device(specimen: Specimen, driver: Driver) -> None:
    """Check that `open` raises a `DriverError` if the device is not there."""
    specimen.unplug()
    _refusal(driver, "opens without its device", driver.open)
    driver.close()


@_check
def check_exchange(specimen: Specimen, driver: Driver) -> None:
    """Check that both plans of a fast driver exchange when compiled; the look plan only reads.

    The driver must have no `fileno` before it is open, and `driven` must tell a driven valve from
    one in its safe state. A slow driver passes.
    """
    if not isinstance(driver, FastDriver):
        return
    plan, look = driver.plan(), driver.look_plan()
    _require(type(plan) is type(look), "has plans of two types")
    _compile_exchange(driver)
    _refusal(driver, "has a connection before it is open", driver.fileno)
    driver.open()
    _require(driver.fileno() >= 0, "has a connection below 0, which means none")
    before = specimen.standing()
    _exchange_well(specimen, driver, look)
    after = specimen.standing()
    _require(after == before, f"moves something by its look plan: {before} to {after}")
    _exchange_well(specimen, driver, plan)
    _require(not specimen.moves or not specimen.is_safe(), "writes nothing by its plan")
    _require(not specimen.moves or bool(driver.driven()), "calls what it drives null")
    _safe(specimen, "after exchanges")
    _require(not driver.driven(), "calls its safe state driven")


@_check
def check_lost_exchange(specimen: Specimen, driver: Driver) -> None:
    """Check that a fast driver's exchange ends in time, with NaN inputs, if the device is gone.

    Then `driven` must raise a `DriverError`. A slow driver passes.
    """
    if not isinstance(driver, FastDriver):
        return
    _compile_exchange(driver)
    driver.open()
    specimen.unplug()
    for plan in (driver.look_plan(), driver.plan()):
        # A reply that the device sent before it was unplugged may still come; later none does.
        for sequence in range(_READINGS):
            status, _, inputs = _exchanged(driver, plan, sequence, {}, 1.0 / driver.rate_hz)
            if status != ExchangeStatus.OK:
                break
        _require(status != ExchangeStatus.OK, "exchanges without its device")
        _require(bool(np.isnan(inputs).all()), f"has inputs after {ExchangeStatus(status)!r}")
    _refusal(driver, "calls its valve null without its device", driver.driven)


CHECKS: Final = tuple(_CHECKS)
"""All checks; they are called one by one, and each makes a specimen of its own."""


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise NonconformityError(f"the driver {otherwise}")


def _bounded(what: str, call: Callable[..., object], *args: object) -> None:
    """Make a call in a thread of its own and wait for its end; raise what it raises.

    Raises:
        NonconformityError: the call takes more than `PATIENCE_S`.
    """
    raised: list[BaseException] = []

    def run() -> None:
        try:
            call(*args)
        except BaseException as error:
            raised.append(error)

    # A call that hangs must not keep the process from ending.
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    _require(not thread.is_alive(), f"hangs: {what} takes more than {PATIENCE_S:g} s")
    if raised:
        raise raised[0]


def _refusal(
    driver: Driver, otherwise: str, call: Callable[..., object], *args: object
) -> DriverError:
    """Return the `DriverError` that a call raises, which must name driver, state and action.

    Args:
        driver: the driver that is called.
        otherwise: what the driver does wrong if the call succeeds, for the message.
        call: the method to call.
        args: its arguments.

    Raises:
        NonconformityError: the call succeeds, raises another error, or hangs.
    """
    try:
        _bounded(otherwise, call, *args)
    except DriverError as error:
        _require(error.driver == driver.name, f"calls itself {error.driver!r} in: {error}")
        _require(bool(error.state and error.action), f"names no state, or no action, in: {error}")
        return error
    except NonconformityError:
        raise
    except Exception as error:
        name = type(error).__name__
        raise NonconformityError(f"the driver raises {name}, no DriverError: {error}") from error
    raise NonconformityError(f"the driver {otherwise}")


def _safe(specimen: Specimen, when: str) -> None:
    _bounded(f"safe_state {when}", specimen.driver.safe_state)
    _require(specimen.is_safe(), f"is not safe after safe_state {when}")


def _leaves_safety(specimen: Specimen) -> bool:
    """Read until the device has left its safe state, and return True; False after 200 readings.

    Return True at once if the specimen has no `moves`.
    """
    for _ in range(_READINGS):
        if not specimen.moves or not specimen.is_safe():
            return True
        specimen.wait(1.0 / specimen.driver.rate_hz)
        specimen.driver.read()
    return False


def _notices(specimen: Specimen) -> bool:
    """Return whether the driver notices in time that its device is gone.

    It notices by an error in `read` or, if it has no outputs, by readings that are all NaN.
    """
    driver = specimen.driver
    for _ in range(_READINGS):
        specimen.wait(1.0 / driver.rate_hz)
        try:
            values = driver.read()
        except DriverError:
            return True
        blind = len(values) == len(driver.inputs) and all(isnan(v) for v in values.values())
        if blind and not driver.outputs:
            return True
    return False


@njit(error_model="numpy", nogil=True)
def _in_compiled_code(
    fd: Any, plan: Any, sequence: Any, outputs: Any, inputs: Any, deadline_ns: Any
) -> Any:
    return exchange(fd, plan, sequence, outputs, inputs, deadline_ns)


def _compile_exchange(driver: FastDriver) -> None:
    """Compile the exchange before it is timed, because compiling may take longer than any call.

    Raises:
        NonconformityError: the exchange cannot be compiled.
    """
    numbers = np.zeros(1)
    arguments = 0, driver.plan(), 0, numbers, numbers, 0
    try:
        if is_jitted(_in_compiled_code):
            _in_compiled_code.compile(tuple(map(typeof, arguments)))
    except (NumbaError, ValueError) as error:
        raise NonconformityError(f"the driver's exchange cannot be compiled: {error}") from error


def _exchanged(
    driver: FastDriver, plan: Plan, sequence: int, values: Mapping[str, float], time_s: float
) -> tuple[int, int, NDArray[np.float64]]:
    """Exchange once as the loop does, with `values` as outputs by name and 0 for all others.

    Returns:
        The status, the time in ns at which the command left, and the inputs.
    """
    outputs = np.array([values.get(name, 0.0) for name in FAST_OUTPUTS])
    inputs = np.zeros(len(FAST_INPUTS))
    returned: list[Any] = []

    def exchange_once() -> None:
        deadline_ns = time.monotonic_ns() + round(1e9 * time_s)
        fd = driver.fileno()
        returned.append(_in_compiled_code(fd, plan, sequence, outputs, inputs, deadline_ns))

    _bounded("exchange", exchange_once)
    match returned:
        case [(int(status), int(sent_ns))]:
            return status, sent_ns, inputs
    raise NonconformityError(f"the driver's exchange returns {returned}, no status and time")


def _exchange_well(specimen: Specimen, driver: FastDriver, plan: Plan) -> None:
    """Exchange until inputs have come and the device has left its safe state, 200 times at most.

    The outputs are the `moves` of the specimen.

    Raises:
        NonconformityError: an exchange fails, gives a wrong time of sending, or has inputs that the
            driver does not declare; or no inputs come.
    """
    for sequence in range(_READINGS):
        values = {**specimen.moves, "host_counter": float(sequence)}
        before = time.monotonic_ns()
        status, sent_ns, inputs = _exchanged(driver, plan, sequence, values, PATIENCE_S)
        name = ExchangeStatus(status).name
        _require(status == ExchangeStatus.OK, f"cannot exchange with its device: {name}")
        within = before <= sent_ns <= time.monotonic_ns()
        _require(within, "does not tell when its request left (CLOCK_MONOTONIC, ns)")
        come = {name for name, value in zip(FAST_INPUTS, inputs, strict=True) if not isnan(value)}
        unknown = sorted(come - set(driver.inputs))
        _require(not unknown, f"exchanges {unknown}, which it does not declare")
        if come and not specimen.is_safe():
            return
        specimen.wait(1.0 / driver.rate_hz)
    _require(bool(come), "exchanges no inputs")
