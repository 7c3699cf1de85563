"""The messages that a digital servovalve and its host exchange cyclically, and their set-up.

RPDO1 is control word and setpoint, TPDO1 is status word and actual spool position; the file
`config/dbc/servovalve.dbc` describes both to other programs. The mapping is written at every start
(CiA 301, sections 7.5.2.33 ff.), so that earlier settings of a valve do not matter.
"""

from collections.abc import Iterator
from typing import Final

from .canopen import PRODUCER_HEARTBEAT, RPDO1, TPDO1, Entry
from .ds408 import ACTUAL, CONTROL_WORD, SETPOINT, STATUS_WORD

COMMAND_LAYOUT: Final = "<Hh"
"""Format of RPDO1 for `struct`: control word, setpoint in increments."""

STATUS_LAYOUT: Final = "<Hh"
"""Format of TPDO1 for `struct`: status word, actual spool position in increments."""

_RPDO1_COMMUNICATION: Final = 0x1400
_TPDO1_COMMUNICATION: Final = 0x1800
_RPDO1_MAPPING: Final = 0x1600
_TPDO1_MAPPING: Final = 0x1A00

TPDO1_PERIOD: Final = Entry(_TPDO1_COMMUNICATION, 5, "<H")
"""Entry of the event timer of TPDO1, the time in ms after which it is sent again."""

_NOT_VALID: Final = 1 << 31
_ON_CHANGE: Final = 255
"""Transmission type: an RPDO acts when it is received, a TPDO is sent when its timer ends."""

_BEATS_IN_SILENCE: Final = 4
"""Number of heartbeats that a node sends in the silence after which it counts as lost."""


def set_up(node: int, rate_hz: float, silence: float) -> Iterator[tuple[Entry, int]]:
    """Yield the entries with the values to write into them, in order, in a pre-operational node.

    Args:
        node: the node's id.
        rate_hz: how often the host reads, Hz; TPDO1 is sent twice as often, so that every read
            finds a new one.
        silence: time in s without a heartbeat after which the host counts the node as lost.
    """
    period_ms = max(1, round(500.0 / rate_hz))
    yield from _pdo(_RPDO1_COMMUNICATION, _RPDO1_MAPPING, RPDO1 + node, (CONTROL_WORD, SETPOINT))
    yield TPDO1_PERIOD, period_ms
    yield from _pdo(_TPDO1_COMMUNICATION, _TPDO1_MAPPING, TPDO1 + node, (STATUS_WORD, ACTUAL))
    yield PRODUCER_HEARTBEAT, round(1e3 * silence / _BEATS_IN_SILENCE)


def _pdo(
    communication: int, mapping: int, identifier: int, mapped: tuple[Entry, ...]
) -> Iterator[tuple[Entry, int]]:
    """Yield the entries and values that map 16-bit entries to a PDO, which is invalid meanwhile."""
    yield Entry(communication, 1, "<I"), _NOT_VALID | identifier
    yield Entry(communication, 2, "<B"), _ON_CHANGE
    yield Entry(mapping, 0, "<B"), 0
    for number, entry in enumerate(mapped, 1):
        yield Entry(mapping, number, "<I"), entry.index << 16 | entry.subindex << 8 | 16
    yield Entry(mapping, 0, "<B"), len(mapped)
    yield Entry(communication, 1, "<I"), identifier
