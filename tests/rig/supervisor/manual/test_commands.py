"""What a person types in manual mode is read in any unit, and refused with a remedy."""

import pytest

from rig.supervisor.manual.bounds import ManualError
from rig.supervisor.manual.commands import HELP, Asked, parse


@pytest.mark.parametrize(
    ("line", "asked"),
    [
        ("by -5mm", Asked("by", value=-0.005)),
        ("by 5 mm speed 10 mm/s", Asked("by", value=0.005, numbers={"speed": 0.01})),
        ("to 0.12m", Asked("to", value=0.12)),
        ("hold out", Asked("hold", "out")),
        ("beat 1234", Asked("beat", beat_ms=1234.0)),
        ("pump high", Asked("pump", "high")),
        ("bypass internal_leakage open", Asked("bypass", "internal_leakage", ball=True)),
        ("bypass internal_leakage 30 %", Asked("bypass", "internal_leakage", value=0.3)),
        (
            "generator sine mean 300mm amplitude 20 mm frequency 0.5Hz",
            Asked("generator", "sine", numbers={"mean": 0.3, "amplitude": 0.02, "frequency": 0.5}),
        ),
        ("generator amplitude 40mm", Asked("generator", numbers={"amplitude": 0.04})),
    ],
)
def test_a_line_is_read(line: str, asked: Asked) -> None:
    read = parse(line)
    assert (read.what, read.which, read.ball, read.beat_ms) == (
        asked.what, asked.which, asked.ball, asked.beat_ms,
    )  # fmt: skip
    assert (read.value is None) == (asked.value is None)
    assert read.value is None or read.value == pytest.approx(asked.value)
    assert read.numbers == pytest.approx(dict(asked.numbers))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("", "nothing is asked for"),
        ("jump", "is no command"),
        ("by", "needs a length"),
        ("by 5", "has no unit"),
        ("by 5 s", "is not a length|length"),
        ("by nan mm", "not a quantity"),
        ("to 5mm fast", "none of speed"),
        ("to 5mm speed", "has no value"),
        ("to 5mm speed 1mm/s speed 2mm/s", "twice"),
        ("hold up", "none of out, in"),
        ("pump", "none of unloaded, low, high"),
        ("stop now", "is too much"),
        ("beat soon", "no time in ms"),
        ("bypass internal_leakage 130%", "no opening"),
        ("bypass internal_leakage", "needs a bypass and"),
        ("generator square amplitude 1mm", "none of sine"),
        ("generator", "none of sine|nothing is asked for"),
    ],
)
def test_what_is_no_command_is_refused_in_words(line: str, why: str) -> None:
    with pytest.raises(ManualError, match=why):
        parse(line)


def test_every_line_of_the_help_is_a_command() -> None:
    for line in HELP.splitlines():
        if not line.startswith(" "):
            example = line[:58].split("  ")[0].replace(" [speed 20mm/s]", "").split(" | ")[0]
            assert parse(example).what == line.split()[0]
