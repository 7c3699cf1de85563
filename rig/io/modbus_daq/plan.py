"""An exchange prepared: its frames as arrays, and where each value goes and comes from."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS

from .frames import Request, exchange_requests, look_request
from .register_map import FEEDBACK_BYTES, WORDS, ExchangeMode, Register, RegisterMap

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]

TYPES: Final = tuple(WORDS)
"""The types of registers, by the index that stands for each in a plan."""

_LONGEST_HEAD: Final = 5


class Tally(IntEnum):
    """Index of each number in `ExchangePlan.tally`."""

    RECEIVED = 0
    """Bytes at the start of the receive buffer that await the rest of their frame."""
    LATE = 1
    """Late replies dropped so far."""
    EXCEPTION = 2
    """Exception code of the last refusal; 0 none so far."""
    SENT_NS = 3
    """When the kernel had the last frame with a command, CLOCK_MONOTONIC; 0 if it did not go."""


class ExchangePlan(NamedTuple):
    """An exchange prepared: frames, where each value goes and comes from, and what it remembers.

    One plan serves one connection; every exchange changes it.

    Attributes:
        frames: uint8, the frames of all transactions, one after the other.
        transactions: int64 (n, 4), of each: first byte and end in `frames`, size of its reply,
            size of the reply's head.
        heads: uint8 (n, 5), the heads expected, from the function code on.
        encode: int64 (outputs, 4): index in `FAST_OUTPUTS`, byte in `frames`, `TYPES` index, bit
            or -1.
        encode_scale: float64 (outputs, 2): gain and bias, SI = gain * number + bias.
        decode: int64 (inputs, 4): index in `FAST_INPUTS`, byte in the last reply, type, bit.
        decode_scale: float64 (inputs, 2), as for outputs.
        low_word_first: int64 (1,), 1 if 32-bit values come so.
        received: uint8, the receive buffer.
        word: uint32 (1,), a 32-bit value on its way to or from float.
        single: float32 (1,), the same memory.
        tally: int64 (4,), by `Tally`.
    """

    frames: Bytes
    transactions: Integers
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


def exchange_plan(register_map: RegisterMap, mode: ExchangeMode, unit: int) -> ExchangePlan:
    """Return the plan of an exchange.

    Args:
        register_map: the device's registers.
        mode: one of its `exchange`.
        unit: unit id of the device, 0 to 255.
    """
    return _plan(register_map, exchange_requests(register_map, mode, unit))


def look_plan(register_map: RegisterMap, mode: ExchangeMode, unit: int) -> ExchangePlan:
    """Return the plan of an exchange that writes nothing; see `exchange_plan`."""
    return _plan(register_map, (look_request(register_map, mode, unit),))


def _plan(register_map: RegisterMap, requests: tuple[Request, ...]) -> ExchangePlan:
    sizes = [len(request.frame) for request in requests]
    ends = np.cumsum(sizes)
    starts = ends - sizes
    written = {
        address: int(start) + at
        for start, request in zip(starts, requests, strict=True)
        for address, at in request.written.items()
    }
    outputs = register_map.written if written else ()
    word = np.zeros(1, np.uint32)
    heads = np.zeros((len(requests), _LONGEST_HEAD), np.uint8)
    for head, request in zip(heads, requests, strict=True):
        head[: len(request.reply_head)] = tuple(request.reply_head)
    return ExchangePlan(
        frames=np.frombuffer(b"".join(request.frame for request in requests), np.uint8).copy(),
        transactions=np.array(
            [
                (start, end, request.reply_size, len(request.reply_head))
                for start, end, request in zip(starts, ends, requests, strict=True)
            ],
            np.int64,
        ),
        heads=heads,
        encode=_table(outputs, FAST_OUTPUTS, written),
        encode_scale=_scales(outputs),
        decode=_table(register_map.read, FAST_INPUTS, requests[-1].returned),
        decode_scale=_scales(register_map.read),
        low_word_first=np.array([register_map.word_order == "low_first"], np.int64),
        received=np.zeros(2 * FEEDBACK_BYTES, np.uint8),
        word=word,
        single=word.view(np.float32),
        tally=np.zeros(len(Tally), np.int64),
    )


def _table(
    registers: tuple[Register, ...], signals: tuple[str, ...], places: Mapping[int, int]
) -> Integers:
    rows = [
        (
            signals.index(register.signal),
            places[register.address],
            TYPES.index(register.type),
            -1 if register.bit is None else register.bit,
        )
        for register in registers
    ]
    return np.array(rows, np.int64).reshape(-1, 4)


def _scales(registers: tuple[Register, ...]) -> Floats:
    scales = [(register.gain, register.bias) for register in registers]
    return np.array(scales, np.float64).reshape(-1, 2)
