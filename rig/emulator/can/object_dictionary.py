"""The object dictionary of an emulated CANopen node, and its SDO server."""

import struct
from collections.abc import Callable, Iterable
from typing import Final

from rig.io import canopen

_WHOLE_REQUEST: Final = 8


class ObjectDictionary:
    """The entries of a node with their values.

    Args:
        values: entries that can be read and written, with their values at power-up.
        live: read-only entries, with the functions that compute them when they are read.
        changed: called with entry and new value after a write from the bus.
    """

    def __init__(
        self,
        values: Iterable[tuple[canopen.Entry, int]],
        live: Iterable[tuple[canopen.Entry, Callable[[], int]]],
        changed: Callable[[canopen.Entry, int], None],
    ) -> None:
        self._values = dict(values)
        self._live = dict(live)
        self._entries = {
            (entry.index, entry.subindex): entry for entry in (*self._values, *self._live)
        }
        self._changed = changed

    def __getitem__(self, entry: canopen.Entry) -> int:
        return self._live[entry]() if entry in self._live else self._values[entry]

    def __setitem__(self, entry: canopen.Entry, value: int) -> None:
        self._values[entry] = value

    def answer(self, data: bytes) -> bytes | None:
        """Return the reply to an SDO request, or its refusal; None if the data are not 8 bytes.

        A request that writes an entry sets it, and then `changed` is called.
        """
        if len(data) != _WHOLE_REQUEST:
            return None
        index, subindex = struct.unpack_from("<HB", data, 1)
        try:
            written = canopen.value_to_write(data)
            entry = self._entries.get((index, subindex))
            if entry is None:
                raise canopen.SdoError(canopen.NO_OBJECT)
            if written is None:
                return canopen.read_reply(entry, self[entry])
            self._write(entry, written)
            return canopen.write_reply(entry)
        except canopen.SdoError as refusal:
            return canopen.abort_reply(index, subindex, refusal.code)

    def _write(self, entry: canopen.Entry, data: bytes) -> None:
        if entry in self._live:
            raise canopen.SdoError(canopen.READ_ONLY)
        if len(data) != struct.calcsize(entry.layout):
            raise canopen.SdoError(canopen.WRONG_LENGTH)
        self._values[entry] = int(struct.unpack(entry.layout, data)[0])
        self._changed(entry, self._values[entry])
