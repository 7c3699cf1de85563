import re
from itertools import pairwise
from math import isnan

import pytest
from hypothesis import given, strategies as st

from rig.io.flow_meters.lines import MeterLine, MeterLineParser, meter_line
from rig.plant.parameters import LITRE_PER_MINUTE

ONE = b"$FM,1,1.250,00*3E\r\n"

lines = st.builds(
    lambda meter, millilitres: (meter, millilitres * 1e-3 * LITRE_PER_MINUTE),
    st.integers(1, 3),
    st.integers(-500, 99_999_999),
)
# Any bytes, and what a bad plug makes of real lines: parts of them, ended or not.
partial = st.builds(lambda line, end: meter_line(*line)[:-end], lines, st.integers(3, 12))
garbage = st.one_of(
    st.binary(max_size=50).filter(lambda noise: not re.search(rb"\*[0-9A-F]{2}\r\n", noise)),
    partial,
    partial.map(lambda line: line + b"\r\n"),
)


def chunked(stream: bytes, cuts: list[int]) -> list[bytes]:
    ends = sorted({min(cut, len(stream)) for cut in cuts} | {0, len(stream)})
    return [stream[a:b] for a, b in pairwise(ends)]


def parsed(stream: bytes, cuts: list[int]) -> tuple[list[MeterLine], MeterLineParser]:
    parser = MeterLineParser()
    return [line for chunk in chunked(stream, cuts) for line in parser.feed(chunk)], parser


def test_a_line_is_a_flow_in_si() -> None:
    assert MeterLineParser().feed(ONE) == [MeterLine(1, 1.25 * LITRE_PER_MINUTE)]


def test_a_flow_is_sent_in_the_line_that_the_protocol_prescribes() -> None:
    assert meter_line(1, 1.25e-3 / 60.0) == ONE


def test_a_failed_sensor_has_no_flow() -> None:
    (line,) = MeterLineParser().feed(meter_line(2, 1e-5, failed=True))

    assert line.meter == 2
    assert isnan(line.flow)


@pytest.mark.parametrize(
    "line",
    [
        b"$FM,4,1.250,00*3B\r\n",
        b"$FM,1,1.25,00*0E\r\n",
        b"$FM,1,nan,00*77\r\n",
        b"$FM,1,1.250,00*3E\n",
        b"$FM,1,1.2\x0050,00*3E\r\n",
        b"\x00\r\n",
        b"\n",
        b"$" * 1000 + b"\n",
        b"x" * 1000 + b"\n",
    ],
)
def test_what_is_no_line_of_a_meter_is_counted_and_left_out(line: bytes) -> None:
    parser = MeterLineParser()

    assert parser.feed(line) == []
    assert (parser.counts.valid, parser.counts.checksum_errors, parser.counts.malformed) == (
        0,
        0,
        1,
    )


@given(position=st.integers(1, len(ONE) - 6), bit=st.integers(0, 7))
def test_no_bit_of_a_line_can_turn_over_unnoticed(position: int, bit: int) -> None:
    line = bytearray(ONE)
    line[position] ^= 1 << bit

    assert MeterLineParser().feed(bytes(line)) == []


def test_a_wrong_checksum_is_counted() -> None:
    parser = MeterLineParser()

    assert parser.feed(ONE.replace(b"*3E", b"*3F") + ONE) != []
    assert (parser.counts.valid, parser.counts.checksum_errors) == (1, 1)


@given(
    parts=st.lists(st.tuples(garbage, lines), max_size=4),
    tail=garbage,
    cuts=st.lists(st.integers(0, 400), max_size=20),
)
def test_any_noise_between_lines_and_any_cut_leaves_exactly_the_valid_lines(
    parts: list[tuple[bytes, tuple[int, float]]], tail: bytes, cuts: list[int]
) -> None:
    stream = b"".join(noise + meter_line(*line) for noise, line in parts) + tail

    found, parser = parsed(stream, cuts)

    expected = [line for _, line in parts]
    assert [line.meter for line in found] == [meter for meter, _ in expected]
    assert [line.flow for line in found] == pytest.approx([flow for _, flow in expected])
    assert parser.counts.valid == len(parts)


@given(stream=st.binary(max_size=400), cuts=st.lists(st.integers(0, 400), max_size=20))
def test_what_is_counted_does_not_depend_on_how_the_stream_is_cut(
    stream: bytes, cuts: list[int]
) -> None:
    stream = stream.replace(b"a", ONE).replace(b"b", b"\n").replace(b"c", b"$")

    assert parsed(stream, cuts)[1].counts == parsed(stream, [])[1].counts
