"""The device for the driver `datagram_daq`: an emulated plant behind a datagram socket."""

import socket
import threading
from types import TracebackType
from typing import Self

import numpy as np

from rig.emulator.plant import EmulatedPlant
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from rig.plant import Model
from tests.waiting import PATIENCE_S

_COMMAND = FAST_OUTPUTS.index("command_V")
_ENABLE = FAST_OUTPUTS.index("valve_enable")
_COUNTER = FAST_OUTPUTS.index("host_counter")


class DatagramDevice:
    """The device, which a thread serves until it is closed.

    Attributes:
        port: its port on 127.0.0.1.
        output_V: present output to the valve, V.
        enabled: whether the valve is enabled.
    """

    def __init__(self) -> None:
        self._plant = EmulatedPlant(Model())
        self.output_V, self.enabled = 0.0, False
        self._other_V: float | None = None
        self._counter = 0
        self._echo = 0.0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port = int(self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def is_null(self) -> bool:
        """Whether the valve is at null and disabled."""
        return not self.enabled and self.output_V == 0.0

    def drive(self, command_V: float) -> None:  # noqa: N803
        """Enable the valve and set its output before the next look, as another master would."""
        self._other_V = command_V

    def close(self) -> None:
        """Stop serving and close the socket; closing again does nothing."""
        if self._thread.is_alive():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
                last.sendto(b"", ("127.0.0.1", self.port))
            self._thread.join(PATIENCE_S)

    def _serve(self) -> None:
        with self._socket:
            while True:
                frame, sender = self._socket.recvfrom(65536)
                if not frame:
                    return
                sequence, *outputs = np.frombuffer(frame).tolist()
                if outputs:
                    self._take(outputs)
                elif self._other_V is not None:
                    self.output_V, self.enabled, self._other_V = self._other_V, True, None
                reply = np.array([sequence, *self._inputs()])
                self._socket.sendto(reply.tobytes(), sender)

    def _take(self, outputs: list[float]) -> None:
        self.enabled = outputs[_ENABLE] == 1.0
        self.output_V = outputs[_COMMAND] if self.enabled else 0.0
        self._echo = outputs[_COUNTER]
        self._plant.drive_valve(self.output_V)

    def _inputs(self) -> list[float]:
        self._counter += 1
        reading = self._plant.reading()
        inputs = {
            "position_m": reading.position,
            "pressure_1_Pa": reading.pressure_1,
            "pressure_2_Pa": reading.pressure_2,
            "spool_m": reading.spool,
            "supply_pressure_Pa": reading.supply_pressure,
            "valve_enabled": float(self.enabled),
            "device_counter": float(self._counter),
            "device_echo": self._echo,
            "device_command_V": self.output_V,
        }
        return [inputs.get(name, np.nan) for name in FAST_INPUTS]
