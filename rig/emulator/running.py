"""The emulator in a thread, for tests and notebooks: `with EmulatorThread() as emulator: ...`."""

import asyncio
import threading
from concurrent.futures import Future, TimeoutError as StillRunning
from typing import Any, Final

from rig.configuration import Rig, load_rig
from rig.emulator.script import NOTHING, Script, fault_from

from .addresses import HOST, Address, Endpoints
from .application import Emulator
from .record import Record

_ANYWHERE: Final = Address(HOST, 0)
_LOOK_S: Final = 0.5
"""Time in s after which a call that waits for an answer checks that the emulator still runs."""
_SIMPLE: Final = Endpoints(_ANYWHERE, bypass=_ANYWHERE, control=_ANYWHERE)


class EmulatorThread:
    """Serves an emulated rig from a thread of its own.

    Unless `rig` or `endpoints` say otherwise, an I/O node, bypass valves and a control port are
    served on free ports; the servovalve is analog, and the pump always runs.

    Args:
        rig: the rig, or its name or file.
        endpoints: addresses of its parts.
        script: faults and operator; by default there is no fault, and nobody presses a button.

    Attributes:
        ports: TCP port or path at which each part is served, by name.
        record: record of what the emulator received and did.

    Raises:
        ConfigError: the rig file is not valid, or there is no such rig.
    """

    def __init__(
        self,
        rig: Rig | str = "simulated",
        *,
        endpoints: Endpoints = _SIMPLE,
        script: Script = NOTHING,
    ) -> None:
        self.record = Record()
        self.ports: dict[str, int | str] = {}
        self._rig = load_rig(rig) if isinstance(rig, str) else rig
        self._endpoints = endpoints
        self._script = script
        self._loop = asyncio.new_event_loop()
        self._emulator: Emulator | None = None
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._serve, name="emulator", daemon=True)

    def __enter__(self) -> "EmulatorThread":
        """Begin to serve, in a thread of its own.

        Raises:
            AddressError: an address is in use, or cannot be used.
            DriverError: the CAN bus cannot be opened.
            LinkError: a serial line cannot be made.
            NotServedError: a fault of the script concerns a part that the rig does not have.
            ServedAlreadyError: another emulator on this machine serves its CAN bus or serial line.
        """
        try:
            self._loop.run_until_complete(self._open())
        except BaseException:
            self._end()
            raise
        self._thread.start()
        return self

    async def _open(self) -> None:
        self._emulator = Emulator(self._rig, self._endpoints, self.record, script=self._script)
        await self._emulator.open()
        self.ports = self._emulator.ports

    def _serve(self) -> None:
        assert self._emulator is not None
        try:
            self._loop.run_until_complete(self._emulator.run())
        except Exception as error:  # the next question or the end of the `with` block raises it
            self._failure = error

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Stop serving, end the thread and close the record.

        If the emulator has failed, its error is raised, unless the `with` block raises one itself.
        """
        assert self._emulator is not None
        self._loop.call_soon_threadsafe(self._emulator.stop)
        self._thread.join()
        self._loop.run_until_complete(self._emulator.close())
        self._end()
        if self._failure is not None and kind is None:
            raise self._failure

    def _end(self) -> None:
        # One more turn of the loop lets the transports close their sockets.
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()
        self.record.close()

    def inject(self, **fault: Any) -> int:
        """Inject a fault that is given by the keys of a script; return its number.

        Raises:
            ConfigError: the fault is not valid; the error names every problem.
            NotServedError: the fault concerns a part that the rig does not have.
            RuntimeError: the emulator has failed.
        """
        return self._ask(lambda emulator: emulator.injection.inject(fault_from(fault)))

    def clear(self, number: int | None = None) -> int:
        """End the fault of a number, or all faults; return how many were ended.

        Raises:
            RuntimeError: the emulator has failed.
        """
        return self._ask(lambda emulator: emulator.injection.clear(number))

    def status(self) -> dict[str, Any]:
        """Return the states of all devices, of the plant and of the faults.

        That of the plant is its true state with the fault coefficients that act, SI.

        Raises:
            RuntimeError: the emulator has failed.
        """
        return self._ask(Emulator.status)

    def _ask(self, question: Any) -> Any:
        """Call `question` with the emulator in the emulator's thread, and return its result.

        Raises:
            RuntimeError: the emulator has failed.
        """
        asked: Future[Any] = Future()

        def answer() -> None:
            try:
                asked.set_result(question(self._emulator))
            except Exception as error:  # the caller of `_ask` raises it
                asked.set_exception(error)

        self._loop.call_soon_threadsafe(answer)
        while True:
            try:
                return asked.result(_LOOK_S)
            except StillRunning:
                if asked.done():
                    raise
                if not self._thread.is_alive():
                    raise RuntimeError("the emulator has failed") from self._failure
