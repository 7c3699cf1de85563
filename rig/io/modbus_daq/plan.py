"""Prepares exchanges: makes arrays of the frames and of the place of each value in them."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS

from .compiled_exchange import TYPES, Checked, ExchangePlan, Floats, Integers, Tally
from .frames import Request, exchange_requests
from .register_map import FEEDBACK_BYTES, ExchangeMode, Register, RegisterMap

_LONGEST_HEAD: Final = 5


def exchange_plans(
    register_map: RegisterMap, mode: ExchangeMode, unit: int, key: int = 0
) -> tuple[ExchangePlan, ExchangePlan]:
    """Return a plan that writes all outputs and reads all inputs, and one that only reads them.

    Both are for one connection: either may receive the rest of a reply to the other.

    Args:
        register_map: the device's registers.
        mode: one of the modes in the map's `exchange`.
        unit: unit id of the device, 0 to 255.
        key: key by which this program owns the device, 1 to 32767; 0 if it does not.
    """
    owned = key != 0 and register_map.owner is not None
    requests, look_request = exchange_requests(register_map, mode, unit, owned=owned)
    plan = _plan(register_map, requests, len(requests))
    _check_replies(plan, register_map, key if owned else 0, requests)
    # Looks and exchanges are counted together, so that no two have the same transaction id.
    look = _plan(register_map, (look_request,), len(requests))
    return plan, look._replace(received=plan.received, tally=plan.tally)


def _plan(
    register_map: RegisterMap, requests: tuple[Request, ...], identifiers: int
) -> ExchangePlan:
    frames, transactions = b"", []
    written: dict[int, int] = {}
    heads = np.zeros((len(requests), _LONGEST_HEAD), np.uint8)
    for request, head in zip(requests, heads, strict=True):
        start, head_size = len(frames), len(request.reply_head)
        written |= {address: start + at for address, at in request.written.items()}
        frames += request.frame
        head[:head_size] = tuple(request.reply_head)
        transactions.append((start, len(frames), request.reply_size, head_size))
    outputs = register_map.written if written else ()
    word = np.zeros(1, np.uint32)
    return ExchangePlan(
        frames=np.frombuffer(frames, np.uint8).copy(),
        transactions=np.array(transactions, np.int64),
        identifiers=identifiers,
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
        checked=np.full(len(Checked), -1, np.int64),
    )


def _check_replies(
    plan: ExchangePlan, register_map: RegisterMap, key: int, requests: tuple[Request, ...]
) -> None:
    """Have the plan write this owner's heartbeat, and judge replies by owner and echo."""
    written, returned = requests[0].written, requests[-1].returned
    addresses = {register.signal: register.address for register in register_map.registers}
    if key and register_map.owner is not None:
        plan.checked[Checked.HEARTBEAT] = written[register_map.owner.heartbeat]
        plan.checked[Checked.TOLD] = returned[register_map.owner.told]
        plan.checked[Checked.BEAT] = key
        plan.checked[Checked.REFUSED] = 0
    if register_map.echo == "exact" and {"device_echo", "host_counter"} <= addresses.keys():
        plan.checked[Checked.COUNTER] = written[addresses["host_counter"]]
        plan.checked[Checked.ECHO] = returned[addresses["device_echo"]]


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
