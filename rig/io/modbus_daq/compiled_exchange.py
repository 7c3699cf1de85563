"""The exchange with a Modbus device once a tick: patch the prebuilt frame, send, receive, decode.

It waits in ppoll until the deadline at most. The part of an incomplete reply that has come stays in
the receive buffer for the next exchange. A reply is recognised by its transaction id, so that one
that comes too late is dropped when it comes.
"""

from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymodbus.constants import ExcCodes

from rig.io import libc
from rig.io.driver import ExchangeStatus
from rig.jit import njit
from rig.plant import inner

from .frames import FUNCTION_AT, LENGTH_AT, TRANSACTION_AT, UNIT_AT
from .register_map import FEEDBACK_BYTES, WORDS

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]

TYPES: Final = tuple(WORDS)
"""The types of registers; a plan gives a type by its index here."""


class Tally(IntEnum):
    """Index of each number in `ExchangePlan.tally`."""

    RECEIVED = 0
    """Number of bytes at the start of the receive buffer whose frame is not yet complete."""
    LATE = 1
    """Number of late replies that were dropped so far."""
    EXCEPTION = 2
    """Exception code of the device's last refusal; 0 before the first."""


class Checked(IntEnum):
    """Index of each number in `ExchangePlan.checked`; -1 stands for what is not checked."""

    HEARTBEAT = 0
    """Byte in `frames` of the register that bears the owner's heartbeat."""
    BEAT = 1
    """Number that was written there last: the key or its complement."""
    TOLD = 2
    """Byte in the last reply of the register that tells whether the device is owned."""
    REFUSED = 3
    """Number of refused writes of others that the device told last."""
    COUNTER = 4
    """Byte in `frames` of `host_counter`."""
    ECHO = 5
    """Byte in the last reply of `device_echo`, which is the counter of the same exchange."""


_U16, _I16, _U32, _I32, _F32 = range(len(TYPES))
_LOWEST: Final = (0.0, -32768.0, 0.0, -2147483648.0)
_HIGHEST: Final = (65535.0, 32767.0, 4294967295.0, 2147483647.0)

(_OK, _TIMEOUT, _EXCEPTION, _WRONG_REPLY, _DISCONNECTED, _GARBAGE, _FOREIGN_WRITE,
 _NOT_OWNER) = map(int, ExchangeStatus)  # fmt: skip
_RECEIVED, _LATE, _CODE = map(int, Tally)
_HEARTBEAT, _BEAT, _TOLD, _REFUSED_WRITES, _COUNTER, _ECHO = map(int, Checked)

OWNED: Final = 6
"""Exception code by which a device refuses what a master writes that does not own it: "server
device busy" (V1.1b3, section 7)."""
_OWNED_BIT: Final = 15
"""Bit that is set while somebody owns the device (docs/io_node.md, register 259)."""
_OLD: Final = 4
"""Number of exchanges by which the echo of an old reply may be behind. One that is further behind
is left to the interlock, which finds a device that takes no writes (`DEVICE_DEAF`)."""

_HEADER: Final = LENGTH_AT + 2
_SHORTEST_REPLY: Final = FUNCTION_AT + 2
"""Bytes of the shortest reply, an exception: header, unit, function and code."""
_REFUSED: Final = 0x80
"""Bit that is set in the function code of an exception reply (V1.1b3, section 7)."""
_STILL_LATE: Final = 0x4000
"""Number of latest transactions whose replies count as late, not as wrong: 16 s at 1 kHz."""


@inner
def encode_outputs(plan, outputs):
    """Write outputs, float64 in the order of `FAST_OUTPUTS`, into the plan's frames.

    An integer register gets the nearest number within its range, a switch 1 for a number of 0.5
    or more. NaN is written as the SI value 0.
    """
    frames = plan.frames
    for row in range(plan.encode.shape[0]):
        at, kind, bit = plan.encode[row, 1], plan.encode[row, 2], plan.encode[row, 3]
        value = outputs[plan.encode[row, 0]]
        if value != value:
            value = 0.0
        number = (value - plan.encode_scale[row, 1]) / plan.encode_scale[row, 0]
        if bit >= 0:
            byte, mask = at + 1 - bit // 8, 1 << (bit % 8)
            frames[byte] = frames[byte] | mask if number >= 0.5 else frames[byte] & ~mask
            continue
        if kind == _F32:
            plan.single[0] = number
            word = np.int64(plan.word[0])
        else:
            clipped = min(max(number, _LOWEST[kind]), _HIGHEST[kind])
            word = np.int64(np.floor(clipped + 0.5))
        if kind in (_U16, _I16):
            frames[at], frames[at + 1] = (word >> 8) & 0xFF, word & 0xFF
            continue
        high = at + 2 * plan.low_word_first[0]
        low = at + 2 - 2 * plan.low_word_first[0]
        frames[high], frames[high + 1] = (word >> 24) & 0xFF, (word >> 16) & 0xFF
        frames[low], frames[low + 1] = (word >> 8) & 0xFF, word & 0xFF


@inner
def decode_inputs(plan, inputs):
    """Write the SI values of the reply in the buffer into `inputs`, in the order of `FAST_INPUTS`.

    Inputs for which the device has no register stay as they are.
    """
    reply = plan.received
    for row in range(plan.decode.shape[0]):
        at, kind, bit = plan.decode[row, 1], plan.decode[row, 2], plan.decode[row, 3]
        first = np.int64(reply[at]) << 8 | np.int64(reply[at + 1])
        if bit >= 0:
            number = np.float64(first >> bit & 1)
        elif kind == _U16:
            number = np.float64(first)
        elif kind == _I16:
            number = np.float64(first - (first >> 15 << 16))
        else:
            second = np.int64(reply[at + 2]) << 8 | np.int64(reply[at + 3])
            swapped = plan.low_word_first[0] == 1
            word = second << 16 | first if swapped else first << 16 | second
            if kind == _F32:
                plan.word[0] = word
                number = np.float64(plan.single[0])
            elif kind == _I32:
                number = np.float64(word - (word >> 31 << 32))
            else:
                number = np.float64(word)
        scaled = plan.decode_scale[row, 0] * number + plan.decode_scale[row, 1]
        inputs[plan.decode[row, 0]] = scaled


@inner
def _drop(plan, size):
    """Remove `size` bytes from the start of the receive buffer."""
    left = plan.tally[_RECEIVED] - size
    for index in range(left):
        plan.received[index] = plan.received[size + index]
    plan.tally[_RECEIVED] = left


@inner
def _judge_reply(plan, transaction, size):
    """Return the status of a whole reply of `size` bytes with the right transaction id.

    The reply is at the start of the receive buffer, and stays there. The exception code of a
    refusal is stored in `plan.tally`.
    """
    reply, frames = plan.received, plan.frames
    start, head_size = plan.transactions[transaction, 0], plan.transactions[transaction, 3]
    function = frames[start + FUNCTION_AT]
    if reply[UNIT_AT] != frames[start + UNIT_AT]:
        return _WRONG_REPLY
    if reply[FUNCTION_AT] == function | _REFUSED:
        plan.tally[_CODE] = reply[FUNCTION_AT + 1]
        return _EXCEPTION
    if size != plan.transactions[transaction, 2]:
        return _WRONG_REPLY
    for index in range(head_size):
        if reply[FUNCTION_AT + index] != plan.heads[transaction, index]:
            return _WRONG_REPLY
    return _OK


@inner
def _receive_reply(fd, plan, transaction, deadline_ns):
    """Wait for the reply to a transaction, and return its `ExchangeStatus`.

    After OK the reply is at the start of the receive buffer. All other whole replies are dropped.
    """
    reply, tally = plan.received, plan.tally
    start = plan.transactions[transaction, 0]
    expected = np.int64(plan.frames[start]) << 8 | np.int64(plan.frames[start + 1])
    while True:
        while tally[_RECEIVED] >= _HEADER:
            protocol = np.int64(reply[2]) << 8 | np.int64(reply[3])
            size = _HEADER + (np.int64(reply[LENGTH_AT]) << 8 | np.int64(reply[LENGTH_AT + 1]))
            if protocol != 0 or size < _SHORTEST_REPLY or size > FEEDBACK_BYTES:
                tally[_RECEIVED] = 0
                while libc.receive(fd, reply, 0) > 0 and libc.monotonic_ns() < deadline_ns:
                    pass
                return _GARBAGE
            if tally[_RECEIVED] < size:
                break
            behind = (expected - (np.int64(reply[0]) << 8 | np.int64(reply[1]))) & 0xFFFF
            if behind == 0:
                status = _judge_reply(plan, transaction, size)
                if status != _OK:
                    _drop(plan, size)
                return status
            _drop(plan, size)
            if behind > _STILL_LATE:
                return _WRONG_REPLY
            tally[_LATE] += 1
        if not libc.wait_readable(fd, deadline_ns):
            return _TIMEOUT
        count = libc.receive(fd, reply, tally[_RECEIVED])
        if count > 0:
            tally[_RECEIVED] += count
        elif count == 0 or (libc.errno() != libc.EAGAIN and libc.errno() != libc.EINTR):
            return _DISCONNECTED


@inner
def _beat(plan):
    """Write the owner's heartbeat into the request: the key and its complement in turn."""
    at = plan.checked[_HEARTBEAT]
    if at < 0:
        return
    plan.checked[_BEAT] ^= 0xFFFF
    plan.frames[at] = plan.checked[_BEAT] >> 8
    plan.frames[at + 1] = plan.checked[_BEAT] & 0xFF


@inner
def _judge_sample(plan):
    """Return the status of an exchange whose replies have come, by what the last one says.

    It is that of an earlier exchange if its echo is; then all else in it is old, too.
    """
    checked, reply, frames = plan.checked, plan.received, plan.frames
    if checked[_ECHO] >= 0:
        at, echo_at = checked[_COUNTER], checked[_ECHO]
        counter = np.int64(frames[at]) << 8 | np.int64(frames[at + 1])
        echo = np.int64(reply[echo_at]) << 8 | np.int64(reply[echo_at + 1])
        if 0 < (counter - echo) & 0xFFFF <= _OLD:
            return _WRONG_REPLY
    if checked[_TOLD] >= 0:
        at = checked[_TOLD]
        told = np.int64(reply[at]) << 8 | np.int64(reply[at + 1])
        if told >> _OWNED_BIT == 0:
            return _NOT_OWNER
        if told & 0x7FFF != checked[_REFUSED_WRITES]:
            checked[_REFUSED_WRITES] = told & 0x7FFF
            return _FOREIGN_WRITE
    return _OK


@inner
def _send_request(fd, plan, transaction, identifier):
    start, stop = plan.transactions[transaction, 0], plan.transactions[transaction, 1]
    plan.frames[start + TRANSACTION_AT] = identifier >> 8
    plan.frames[start + TRANSACTION_AT + 1] = identifier & 0xFF
    sent = libc.send(fd, plan.frames, start, stop)
    if sent == stop - start:
        return _OK
    # A request of which no byte was sent may be sent again; half a frame cannot be completed later.
    if sent < 0 and (libc.errno() == libc.EAGAIN or libc.errno() == libc.EINTR):
        return _TIMEOUT
    return _DISCONNECTED


class ExchangePlan(NamedTuple):
    """A prepared exchange: its frames, the place of each value in them, and its memory.

    A plan serves one connection, and every exchange changes its arrays.

    Attributes:
        frames: uint8, the frames of all transactions, one after the other.
        transactions: int64 (n, 4), for each transaction: first byte and end of its request in
            `frames`, size of its reply in bytes, size of the reply's head in bytes.
        identifiers: number of transaction ids by which the count goes on at each exchange.
        heads: uint8 (n, 5), the bytes that each reply must have from its function code on.
        encode: int64 (outputs, 4), for each output: index in `FAST_OUTPUTS`, byte in `frames`,
            index in `TYPES`, and bit or -1.
        encode_scale: float64 (outputs, 2): gain and bias, SI = gain * number + bias.
        decode: int64 (inputs, 4), for each input: index in `FAST_INPUTS`, byte in the last reply,
            index in `TYPES`, and bit or -1.
        decode_scale: float64 (inputs, 2): gain and bias, as for outputs.
        low_word_first: int64 (1,), 1 if the low word of a 32-bit value comes first, else 0.
        received: uint8, the receive buffer.
        word: uint32 (1,), scratch for a 32-bit value that is converted to or from float.
        single: float32 (1,), the same memory as `word`.
        tally: int64 (3,), indexed by `Tally`.
        checked: int64 (6,), indexed by `Checked`.
    """

    frames: Bytes
    transactions: Integers
    identifiers: int
    heads: Bytes
    encode: Integers
    encode_scale: Floats
    decode: Integers
    decode_scale: Floats
    low_word_first: Integers
    received: Bytes
    word: NDArray[np.uint32]
    single: NDArray[np.float32]
    tally: Integers
    checked: Integers

    @njit(cache=True, error_model="numpy", nogil=True)
    def exchange(self, fd, sequence, outputs, inputs, deadline_ns):
        """Write outputs and read inputs by all transactions; see `rig.io.driver.Plan.exchange`.

        Args:
            fd: a connected socket in blocking mode.
            sequence: number of the exchange, from which its transaction ids follow.
            outputs: values of `FAST_OUTPUTS`, SI.
            inputs: filled with the values of `FAST_INPUTS`, SI.
            deadline_ns: deadline of all replies together, on CLOCK_MONOTONIC.

        Returns:
            The `ExchangeStatus`, and the time on CLOCK_MONOTONIC in ns at which the command left, 0
            if it did not leave.
        """
        inputs[:] = np.nan
        sent_ns = 0
        encode_outputs(self, outputs)
        _beat(self)
        count = self.transactions.shape[0]
        for transaction in range(count):
            identifier = (sequence * self.identifiers + transaction) & 0xFFFF
            status = _send_request(fd, self, transaction, identifier)
            if status != _OK:
                return status, sent_ns
            if transaction == 0:
                # In every mode the first transaction carries the outputs.
                sent_ns = libc.monotonic_ns()
            status = _receive_reply(fd, self, transaction, deadline_ns)
            if status == _EXCEPTION and self.checked[_TOLD] >= 0 and self.tally[_CODE] == OWNED:
                return _NOT_OWNER, sent_ns
            if status != _OK:
                return status, sent_ns
            if transaction == count - 1:
                status = _judge_sample(self)
                if status in (_OK, _FOREIGN_WRITE):
                    decode_inputs(self, inputs)
            _drop(self, self.transactions[transaction, 2])
        return status, sent_ns


def exception_name(code: int) -> str:
    """Return a Modbus exception code with its name in the standard (V1.1b3, section 7)."""
    names = {int(member): member.name.lower().replace("_", " ") for member in ExcCodes}
    return f"exception {code} ({names.get(code, 'not in the standard')})"
