"""The emulator in a thread, for tests and notebooks: `with EmulatorThread() as emulator: ...`."""

import asyncio
import threading
from concurrent.futures import Future, TimeoutError as StillRunning
from types import TracebackType
from typing import Any, Final

from rig.configuration import Rig, load_rig
from rig.emulator.script import NOTHING, Script, fault_from

from .addresses import HOST, Address, Endpoints
from .application import Emulator
from .record import Record

_ANYWHERE: Final = Address(HOST, 0)
_LOOK_S: Final = 0.5
"""How often somebody who waits for an answer looks whether the emulator still runs."""
_SIMPLE: Final = Endpoints(_ANYWHERE, bypass=_ANYWHERE, control=_ANYWHERE)


class EmulatorThread:
    """Serves an emulated rig from a thread of its own.

    Unless `rig` or `endpoints` say otherwise, an I/O node, bypass valves and a control port are
    served on free ports; the servovalve is analog, and the pump always runs.

    Args:
        rig: the rig, or its name or file.
        endpoints: where it is served.
        script: what happens by itself; nothing, if not given, and nobody presses a button.

    Attributes:
        ports: where each part is served, by name.
        record: what it received.
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
        """Serve.

        Raises:
            AddressError: an address is in use, or not to be had.
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
        except Exception as error:  # for whoever asks next, or leaves
            self._failure = error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop serving and end the thread; raise why it ended before, if it did."""
        assert self._emulator is not None
        self._loop.call_soon_threadsafe(self._emulator.stop)
        self._thread.join()
        self._loop.run_until_complete(self._emulator.close())
        self._end()
        if self._failure is not None and error is None:
            raise self._failure

    def _end(self) -> None:
        # One more turn of the loop lets the transports close their sockets.
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()
        self.record.close()

    def inject(self, **fault: Any) -> int:
        """Inject a fault given by the keys of a script; return its number.

        Raises:
            ConfigError: every problem with it.
        """
        return self._ask(lambda emulator: emulator.injection.inject(fault_from(fault)))

    def clear(self, number: int | None = None) -> int:
        """End one fault, or all; return how many there were."""
        return self._ask(lambda emulator: emulator.injection.clear(number))

    def status(self) -> dict[str, Any]:
        """Return how every device stands, and the plant's true state, SI."""
        return self._ask(Emulator.status)

    def _ask(self, question: Any) -> Any:
        """Return the answer to a question put to the emulator in its own thread.

        Raises:
            RuntimeError: the emulator has failed.
        """
        asked: Future[Any] = Future()

        def answer() -> None:
            try:
                asked.set_result(question(self._emulator))
            except Exception as error:  # for whoever asked
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
