"""CANopen frames, against the layout that CiA 301 gives and by way of the emulated server."""

import pytest
from hypothesis import given, strategies as st

from rig.emulator.can.object_dictionary import ObjectDictionary
from rig.io.can.canopen import (
    Entry,
    SdoError,
    answers,
    emergency_words,
    read_request,
    value_of,
    write_request,
)

BYTE, SIGNED_WORD, WORD = Entry(0x6042, 0, "<b"), Entry(0x6300, 1, "<h"), Entry(0x6040, 0, "<H")
LONG = Entry(0x1016, 1, "<I")
STATUS = Entry(0x6041, 0, "<H")


def test_requests_are_those_of_the_specification() -> None:
    assert read_request(STATUS) == bytes.fromhex("4041600000000000")
    assert write_request(BYTE, 2) == bytes.fromhex("2f42600002000000")
    assert write_request(WORD, 0x000F) == bytes.fromhex("2b4060000f000000")
    assert write_request(SIGNED_WORD, -16384) == bytes.fromhex("2b00630100c00000")
    assert write_request(LONG, 0x007F03E8) == bytes.fromhex("23161001e8037f00")


@given(value=st.integers(-(1 << 15), (1 << 15) - 1))
def test_a_value_written_is_read_back(value: int) -> None:
    written: list[int] = []
    objects = ObjectDictionary([(SIGNED_WORD, 0)], [], lambda _, value: written.append(value))
    reply = objects.answer(write_request(SIGNED_WORD, value))
    assert reply is not None
    assert answers(reply, SIGNED_WORD)
    assert not answers(reply, WORD)
    reply = objects.answer(read_request(SIGNED_WORD))
    assert reply is not None
    assert value_of(reply, SIGNED_WORD) == value
    assert written == [value]


@pytest.mark.parametrize(
    ("request_data", "why"),
    [
        (read_request(LONG), "the object does not exist"),
        (write_request(STATUS, 1), "the object is read only"),
        (write_request(Entry(0x6040, 0, "<I"), 1), "the length does not match"),
        (bytes.fromhex("2140600000000000"), "unknown command"),
    ],
)
def test_a_refusal_comes_in_words(request_data: bytes, why: str) -> None:
    objects = ObjectDictionary([(WORD, 0)], [(STATUS, lambda: 8)], lambda *_: None)
    reply = objects.answer(request_data)
    assert reply is not None
    with pytest.raises(SdoError, match=why):
        value_of(reply, WORD)


def test_a_reply_of_another_length_is_no_value() -> None:
    with pytest.raises(ValueError, match=r"is not 2 bytes of object 0x6040:0"):
        value_of(bytes.fromhex("4340600001000000"), WORD)


@given(data=st.binary(max_size=10))
def test_no_request_upsets_the_server(data: bytes) -> None:
    reply = ObjectDictionary([(WORD, 0)], [], lambda *_: None).answer(data)
    assert reply is None or len(reply) == 8


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x8130, "heartbeat of the host lost"),
        (0x4210, "device temperature"),
        (0x8199, "communication"),
        (0x0000, "error reset"),
        (0x1234, "unknown error"),
    ],
)
def test_an_emergency_is_reported_in_words(code: int, words: str) -> None:
    assert emergency_words(code) == words
