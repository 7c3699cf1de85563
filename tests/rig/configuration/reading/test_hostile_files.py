"""A file of configuration that is meant to harm is refused in a moment, with a clear message."""

import os
from pathlib import Path

import pytest

from rig.configuration import ConfigError, check, load_rig, shipped_config_dir
from rig.configuration.reading import Sources, document, problems
from rig.configuration.reading.document import LONGEST_NUMBER


def problems_of(tmp_path: Path, content: str) -> list[str]:
    path = tmp_path / "campaign.yaml"
    path.write_text(content)
    with pytest.raises(ConfigError) as caught:
        check(path)
    return str(caught.value).splitlines()


@pytest.mark.parametrize(
    "number",
    ["0x" + "f" * 5000, "1" + ":1" * 50_000, "9" * 100_000, "1." + "9" * 200, "0b" + "1" * 99],
    ids=["hexadecimal", "sixties", "decimal", "float", "binary"],
)
def test_a_number_that_no_machine_has_is_refused_unread(tmp_path: Path, number: str) -> None:
    lines = problems_of(tmp_path, f"name: a\nrig: simulated\ntests:\n  - {{seed: {number}}}\n")
    (about,) = (line for line in lines if " seed: " in line)
    assert f"characters, above {LONGEST_NUMBER}; write fewer digits" in about
    assert ":4:6 seed: " in about
    assert len(about) < 400


def test_the_longest_number_is_still_read(tmp_path: Path) -> None:
    path = tmp_path / "numbers.yaml"
    path.write_text(f"binary: 0b{'1' * (LONGEST_NUMBER - 2)}\n")
    root = Sources().read_yaml(path)
    assert root is not None
    assert root.plain() == {"binary": 2 ** (LONGEST_NUMBER - 2) - 1}


def test_a_nul_is_refused_wherever_it_stands(tmp_path: Path) -> None:
    lines = problems_of(tmp_path, 'name: "a\\0b"\nrig: "a\\0b.yaml"\nmodel: "\\0"\ntests: []\n')
    reason = r"has the character \x00, which no name and no path can have"
    assert sum(reason in line for line in lines) == 3
    assert "a\\x00b" in lines[0]


@pytest.mark.parametrize(
    "name", ["a" * 300, "a" * 300 + ".yaml", "/proc/self/cwd/" * 60 + "x.yaml"]
)
def test_a_reference_that_no_file_can_have_is_unknown(tmp_path: Path, name: str) -> None:
    lines = problems_of(tmp_path, f"name: a\nrig: {name}\ntests: []\n")
    about = next(line for line in lines if ":2:1 rig: " in line)
    reasons = ("is not a known rig", "cannot be a path: ", "does not exist")
    assert any(reason in about for reason in reasons)


def test_a_rig_s_name_is_no_longer_than_the_files_that_are_named_by_it(tmp_path: Path) -> None:
    shipped = (shipped_config_dir() / "rigs" / "simulated.yaml").read_text()
    path = tmp_path / "rig.yaml"
    path.write_text(shipped.replace("name: simulated", f"name: {'x' * 200}"))
    assert load_rig(path).name == "x" * 200
    path.write_text(shipped.replace("name: simulated", f"name: {'x' * 300}"))
    with pytest.raises(ConfigError, match="has 300 characters, above 200; shorten it"):
        load_rig(path)


def test_a_file_of_mistakes_lists_the_first_thousand(tmp_path: Path) -> None:
    lines = problems_of(tmp_path, "name: a\nrig: simulated\ntests: [" + "1, " * 3000 + "]\n")
    assert len(lines) == problems.MOST_FOUND + 1
    assert "tests[0]: 1 is no test" in lines[0]
    assert "has more than the 1000 mistakes that are listed here; mend these first" in lines[-1]


def test_mistakes_that_an_alias_repeats_are_listed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(problems, "MOST_REPORTED", 500)
    mistakes = ", ".join(f"a{number}: 1" for number in range(20))
    tests = "".join("  - *x\n" for _ in range(100))
    lines = problems_of(tmp_path, f"x: &x {{{mistakes}}}\nname: a\nrig: simulated\ntests:\n{tests}")
    assert sum("a7: is not a known key" in line for line in lines) == 1
    assert "mistakes that are listed here; mend these first" in lines[-1]


def test_a_file_with_more_values_than_any_has_is_refused_before_they_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(document, "MAX_VALUES", 5000)  # the true limit takes a second to reach
    (line,) = problems_of(tmp_path, "tests: [" + "1," * 10_001 + "]\n")
    assert "cannot be parsed: it has more than 5000 values" in line


def test_a_file_of_holes_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "holes.yaml"
    with path.open("wb") as file:
        file.truncate(6_000_000_000)
    with pytest.raises(ConfigError, match="it is larger than 8 MB; is it the right file"):
        check(path)


def test_a_pipe_that_a_file_names_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    setpoint = "{type: file, path: pipe.csv}"
    lines = problems_of(
        tmp_path, f"name: a\nrig: simulated\ntests: [{{name: a, setpoint: {setpoint}}}]\n"
    )
    assert any("cannot be read: it is a pipe; check the path" in line for line in lines)


def test_a_long_value_does_not_hide_what_is_wrong_with_it() -> None:
    found = problems.Problem("rig.yaml", 3, 1, "k" * 9000, "v" * 9000, "is wrong", "mend it")
    line = str(found)
    assert len(line) < 4000
    assert line.startswith("rig.yaml:3:1 kkk")
    assert line.endswith("... is wrong; mend it")
