"""`rig commission`: whom it asks, what it refuses, what it writes, and how it ends."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from rig.cli.hardware import commission
from rig.cli.hardware.commission import Terminal
from rig.cli.screen import Screen
from rig.configuration import load_rig
from rig.io.wiring import Wiring
from rig.loop.interlocks.trip import StopRequestedError
from rig.runner.commissioning.commissioning import Commissioning
from rig.runner.commissioning.findings import Changes, Finding
from rig.runner.commissioning.operator import DeclinedError
from rig.runner.commissioning.probing import NotFoundError
from tests.rig.cli.conftest import Invoke

TEXT = "name: mine\nparent: emulated  # as it is\n"
POLARITY = Finding("valve polarity", "inverted", "normal", "changed", "told by the bypass valves")
STROKE = Finding("stroke", "", "606.9 mm", "not found", "no end of the approach")

Finds = Callable[..., None]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT)
    return path


@pytest.fixture
def finds(monkeypatch: pytest.MonkeyPatch) -> Finds:
    """Return a function by which the steps find what it is given, and may end by an error."""

    def put(*findings: Finding, error: Exception | None = None) -> None:
        def run(self: Commissioning) -> None:
            self.findings += findings
            self.changes = Changes(wiring=Wiring(valve="inverted"))
            if error is not None:
                raise error

        monkeypatch.setattr(Commissioning, "run", run)

    return put


def test_what_was_found_is_written_and_shown(invoke: Invoke, file: Path, finds: Finds) -> None:
    finds(POLARITY)
    done = invoke("commission", file, "--yes", "--folder", "out")
    assert done.code == 0
    assert load_rig(file).wiring == Wiring(valve="inverted")
    assert file.read_text().startswith(TEXT)
    (backup,) = file.parent.glob("mine.yaml.*.bak")
    assert backup.read_text() == TEXT
    assert "valve polarity" in done.out
    page = Path("out/commissioning.html").read_text()
    assert "valve polarity: inverted, before normal (told by the bypass valves)" in page
    assert "Everything that was looked for was found" in page


def test_what_was_not_found_is_named_with_its_remedy_and_the_code_tells(
    invoke: Invoke, file: Path, finds: Finds
) -> None:
    finds(POLARITY, STROKE)
    done = invoke("commission", file, "--yes", "--json", "--folder", "out")
    assert done.code == 1
    told = json.loads(done.out)
    assert told["schema"] == "rig-commissioning"
    assert not told["complete"]
    assert told["findings"][1]["standing"] == "not found"
    assert "stroke: no end of the approach" in Path("out/commissioning.html").read_text()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (NotFoundError("the ram does not answer"), 1),
        (DeclinedError("not agreed to"), 3),
    ],
)
def test_an_early_end_leaves_the_rig_file_as_it_was_and_says_why(
    invoke: Invoke, file: Path, finds: Finds, error: Exception, code: int
) -> None:
    finds(POLARITY, error=error)
    done = invoke("commission", file, "--yes", "--folder", "out")
    assert done.code == code
    assert str(error) in done.err
    assert "rig file: unchanged" in done.out
    assert file.read_text() == TEXT
    assert not list(file.parent.glob("*.bak"))
    assert str(error) in Path("out/commissioning.html").read_text()


def test_without_a_terminal_nobody_can_be_asked(
    invoke: Invoke, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Path(os.devnull).open() as nobody:
        monkeypatch.setattr("sys.stdin", nobody)
        done = invoke("commission", file, "--json")
    assert done.code == 2
    assert "no terminal in which to ask before each motion" in done.err
    assert "--json: nobody can be asked" in done.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["emulated", "--yes"], "is a shipped rig; give --out FILE"),
        (["simulated", "--yes", "--out", "new.yaml"], "give a rig with `backend: hardware`"),
        (["emulated", "--yes", "--out", "new.txt"], "does not end in .yaml"),
    ],
)
def test_what_cannot_be_commissioned_is_refused_with_the_remedy(
    invoke: Invoke, arguments: list[str], words: str
) -> None:
    done = invoke("commission", *arguments)
    assert done.code == 2
    assert words in done.err


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Terminal]]:
    """Return a function that makes an operator who types lines, and then ends his input."""
    monkeypatch.setattr(commission, "_LOOK_S", 0.01)
    with ExitStack() as open_files:

        def make(lines: str) -> Terminal:
            reading, writing = os.pipe()
            os.write(writing, lines.encode())
            os.close(writing)
            monkeypatch.setattr("sys.stdin", open_files.enter_context(os.fdopen(reading)))
            return Terminal(Screen())

        yield make


@pytest.mark.parametrize(
    ("line", "agreed"), [("y\n", True), ("YES\n", True), ("\n", False), ("n\n", False), ("", False)]
)
def test_only_a_clear_yes_is_the_operator_s_word(
    typed: Callable[[str], Terminal], line: str, agreed: bool
) -> None:
    assert typed(line).agrees("The ram moves", lambda: None) is agreed


@pytest.mark.parametrize(("line", "way"), [("out\n", 1), ("i\n", -1), ("\n", 0), ("", 0)])
def test_the_operator_tells_which_way_the_rod_moved(
    typed: Callable[[str], Terminal], line: str, way: int
) -> None:
    assert typed(line).way(lambda: None) == way


def test_while_nobody_answers_the_rig_is_looked_after(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(commission, "_LOOK_S", 0.01)
    looks: list[None] = []

    def alive() -> None:
        looks.append(None)
        if len(looks) == 3:
            raise StopRequestedError("stopped by SIGINT")

    reading, writing = os.pipe()
    with os.fdopen(reading) as nothing, os.fdopen(writing, "w"):
        monkeypatch.setattr("sys.stdin", nothing)
        with pytest.raises(StopRequestedError):
            Terminal(Screen()).agrees("The ram moves", alive)
