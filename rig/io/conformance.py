"""What every driver has to do, as checks that any driver can be run through (docs/drivers.md).

A check takes a factory of specimens, a driver with a device each, and raises `NonconformityError`
if the driver does not behave as `rig.io.driver.Driver` says, and a fast one as `FastDriver`. It
needs no test framework.
"""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, is_dataclass
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
"""No call of a driver may take longer; a thousand times what most take, for busy machines."""

_READINGS: Final = 200
"""How many readings at the driver's rate may pass until something is bound to show."""

_NO_SIGNAL: Final = "no_such_signal"

_NAMES: Final = {
    "fast": (FAST_INPUTS, FAST_OUTPUTS),
    "slow": (SLOW_INPUTS, SLOW_OUTPUTS),
}


class NonconformityError(AssertionError):
    """A driver does not do what every driver has to."""


@dataclass(frozen=True)
class Specimen:
    """A driver to check, and a device of its own.

    Attributes:
        driver: not yet open; its device is there, and safe.
        unplug: takes the device away, for good.
        standing: returns what the device's outputs stand at, in any form that can be compared.
        is_safe: returns whether the device's outputs stand in their safe state.
        moves: values to write that leave the safe state.
        wait: lets a time in s pass.
    """

    driver: Driver
    unplug: Callable[[], object]
    standing: Callable[[], object] = lambda: None
    is_safe: Callable[[], bool] = lambda: True
    moves: Mapping[str, float] = field(default_factory=dict)
    wait: Callable[[float], None] = time.sleep


Factory = Callable[[], AbstractContextManager[Specimen]]
"""Makes a specimen, and puts it away when the check is over."""

Check = Callable[[Factory], None]


def check_declaration(factory: Factory) -> None:
    """Its name, kind, options, signals and rate are declared, and known to the rig."""
    with factory() as specimen:
        driver = specimen.driver
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


def check_open_and_close(factory: Factory) -> None:
    """Open and close do no harm when repeated, and it can be opened again."""
    with factory() as specimen:
        driver = specimen.driver
        driver.close()
        for _ in range(2):
            driver.open()
            driver.open()
            driver.read()
            driver.close()
            driver.close()


def check_not_open(factory: Factory) -> None:
    """Before it is open, and after it is closed, it refuses to read and write."""
    with factory() as specimen:
        driver = specimen.driver
        for when in ("before it is open", "after it is closed"):
            _refusal(driver, f"reads {when}", driver.read)
            if specimen.moves:
                _refusal(driver, f"writes {when}", driver.write, specimen.moves)
            driver.open()
            driver.close()
        _require(specimen.is_safe(), "moves something though it is not open")


def check_open_moves_nothing(factory: Factory) -> None:
    """Opening, reading and closing leave every output where it stands."""
    with factory() as specimen:
        driver, before = specimen.driver, specimen.standing()
        driver.open()
        for _ in range(3):
            specimen.wait(1.0 / driver.rate_hz)
            driver.read()
        driver.close()
        after = specimen.standing()
        _require(after == before, f"moves something before the first write: {before} to {after}")


def check_readings(factory: Factory) -> None:
    """The driver reads every input sooner or later and nothing else, as finite floats or NaN."""
    with factory() as specimen:
        driver = specimen.driver
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


def check_bad_outputs(factory: Factory) -> None:
    """It refuses an output that it lacks and a value that is none, by name, and sends nothing."""
    with factory() as specimen:
        driver = specimen.driver
        driver.open()
        before = specimen.standing()
        for signal, value in {_NO_SIGNAL: 1.0, **dict.fromkeys(driver.outputs, nan)}.items():
            outputs = {**specimen.moves, signal: value}
            error = _refusal(driver, f"writes {signal} = {value}", driver.write, outputs)
            named = signal in error.channel
            _require(named, f"refuses {signal} = {value} without naming it: {error}")
        after = specimen.standing()
        _require(after == before, f"obeys a write that it refuses: {before} to {after}")


def check_safe_state(factory: Factory) -> None:
    """It reaches its safe state: unopened, at once, after any move, again, and after closing."""
    with factory() as specimen:
        driver = specimen.driver
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


def check_vanished_device(factory: Factory) -> None:
    """Without its device it says so and never hangs; if it moves something, by an error."""
    with factory() as specimen:
        driver = specimen.driver
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


def check_absent_device(factory: Factory) -> None:
    """It cannot be opened without its device, and says so."""
    with factory() as specimen:
        specimen.unplug()
        _refusal(specimen.driver, "opens without its device", specimen.driver.open)
        specimen.driver.close()


def check_exchange(factory: Factory) -> None:
    """A fast one exchanges by its plan, compiled as in the loop; by its look plan it only reads."""
    with factory() as specimen:
        driver = specimen.driver
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


def check_lost_exchange(factory: Factory) -> None:
    """Without its device a fast one's exchange ends by its deadline, and has no inputs."""
    with factory() as specimen:
        driver = specimen.driver
        if not isinstance(driver, FastDriver):
            return
        _compile_exchange(driver)
        driver.open()
        specimen.unplug()
        for plan in (driver.look_plan(), driver.plan()):
            # What the device had sent before may still come; in the end nothing does.
            for sequence in range(_READINGS):
                status, _, inputs = _exchanged(driver, plan, sequence, {}, 1.0 / driver.rate_hz)
                if status != ExchangeStatus.OK:
                    break
            _require(status != ExchangeStatus.OK, "exchanges without its device")
            _require(bool(np.isnan(inputs).all()), f"has inputs after {ExchangeStatus(status)!r}")
        _refusal(driver, "calls its valve null without its device", driver.driven)


CHECKS: Final[tuple[Check, ...]] = (
    check_declaration,
    check_open_and_close,
    check_not_open,
    check_open_moves_nothing,
    check_readings,
    check_bad_outputs,
    check_safe_state,
    check_vanished_device,
    check_absent_device,
    check_exchange,
    check_lost_exchange,
)
"""Every check, to be run one by one; each makes its own specimen."""


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise NonconformityError(f"the driver {otherwise}")


def _bounded(what: str, call: Callable[..., object], *args: object) -> None:
    """Make a call that must return, or raise, in time."""
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
    """Return the error by which a call is refused, which has to be a helpful one."""
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
    """Return whether the device moves in the end, if anything is to move."""
    for _ in range(_READINGS):
        if not specimen.moves or not specimen.is_safe():
            return True
        specimen.wait(1.0 / specimen.driver.rate_hz)
        specimen.driver.read()
    return False


def _notices(specimen: Specimen) -> bool:
    """Return whether readings fail, or have no values, for want of the device."""
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
    """Compile it apart, because that may take longer than any call of a driver."""
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
    """Exchange as the loop does; return status, when the command left, and inputs."""
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
    """Exchange often enough for inputs to come, and for a device that is commanded to move."""
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
