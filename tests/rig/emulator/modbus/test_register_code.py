from typing import Any, Literal

import pytest
from hypothesis import given, strategies as st
from pymodbus.client.mixin import ModbusClientMixin

from rig.emulator.modbus.mapped_device import RegisterCode, addresses
from rig.io.modbus_daq.register_map import RegisterValue

ORDERS: Any = st.sampled_from(["high_first", "low_first"])


@given(ORDERS, st.floats(width=32, allow_nan=False))
def test_what_is_coded_is_decoded(order: Any, number: float) -> None:
    code = RegisterCode(order)
    place = RegisterValue(100, "F32", 0.0)
    words = code.words(place, number)
    assert words.keys() == {100, 101}
    assert code.number(place, words) == number


@pytest.mark.parametrize(("order", "theirs"), [("high_first", "big"), ("low_first", "little")])
@given(number=st.integers(-(2**31), 2**31 - 1))
def test_words_are_those_of_pymodbus(
    order: Literal["high_first", "low_first"], theirs: Any, number: int
) -> None:
    expected = ModbusClientMixin.convert_to_registers(
        number, ModbusClientMixin.DATATYPE.INT32, word_order=theirs
    )
    place = RegisterValue(0, "I32", 0.0)
    assert list(RegisterCode(order).words(place, number).values()) == expected


def test_whole_numbers_saturate_at_the_ends_of_their_type() -> None:
    code = RegisterCode("high_first")
    assert code.words(RegisterValue(0, "U16", 0.0), -1.0) == {0: 0}
    assert code.words(RegisterValue(0, "I16", 0.0), 1e9) == {0: 0x7FFF}


def test_a_number_takes_the_addresses_of_its_type() -> None:
    assert list(addresses(RegisterValue(7, "U16", 0.0))) == [7]
    assert list(addresses(RegisterValue(7, "F32", 0.0))) == [7, 8]
