"""Which master owns the emulated I/O node, as docs/io_node.md specifies it."""

from typing import Final

from rig.emulator.record import Record

from .functions import BUSY, ILLEGAL_VALUE, ModbusException

_LAST_KEY: Final = 0x7FFF
_OWNED: Final = 0x8000


class Owner:
    """The owner of a node, if there is one, and what others tried meanwhile.

    Args:
        record: takes note when the owner changes, and of the first write of another master.

    Attributes:
        refused: number of writes and claims of others that were refused since the last claim.
        beats: whether the last write that was taken continued the owner's heartbeat; without an
            owner it always does.
    """

    def __init__(self, record: Record) -> None:
        self.refused = 0
        self.beats = True
        self._record = record
        self._key = 0
        self._beat = 0
        self._beaten_ns = 0

    @property
    def is_there(self) -> bool:
        """Whether somebody owns the node."""
        return self._key != 0

    @property
    def told(self) -> int:
        """Number in register 259: 0 without an owner."""
        return _OWNED | self.refused & _LAST_KEY if self.is_there else 0

    def claim(self, key: int, now_ns: int, watchdog_ns: int) -> None:
        """Let a master own the node by a key, unless another owner's heart beats.

        Raises:
            ModbusException: the key is not 1 to 32767, or another owner's heartbeat has changed
                within the watchdog's time.
        """
        if not 0 < key <= _LAST_KEY:
            raise ModbusException(ILLEGAL_VALUE)
        if self._key not in (0, key) and now_ns - self._beaten_ns < watchdog_ns:
            self._refuse(now_ns)
            raise ModbusException(BUSY)
        self._key, self._beat, self._beaten_ns, self.refused = key, 0, now_ns, 0
        self._record.note("owner_claimed", now_ns)

    def release(self, key: int, now_ns: int) -> None:
        """Let the owner give the node up.

        Raises:
            ModbusException: the key is not that of the owner.
        """
        if key != self._key or not key:
            self._refuse(now_ns)
            raise ModbusException(BUSY)
        self._key, self.beats = 0, True
        self._record.note("owner_released", now_ns)

    def may_write(self, beat: int | None, now_ns: int) -> bool:
        """Return whether a write is taken, by the heartbeat in it; None: it has none."""
        if not self.is_there:
            return True
        if beat not in (self._key, self._key ^ 0xFFFF):
            self._refuse(now_ns)
            return False
        self.beats = beat != self._beat
        if self.beats:
            self._beat, self._beaten_ns = beat, now_ns
        return True

    def _refuse(self, now_ns: int) -> None:
        # Somebody who writes a thousand times a second shall not fill the record.
        if self.refused == 0:
            self._record.note("another_master_refused", now_ns)
        self.refused += 1
