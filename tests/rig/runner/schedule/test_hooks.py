"""Hooks: words that no shell sees, and that end no schedule."""

import sys
from pathlib import Path

from hypothesis import given, strategies as st

from rig.runner.schedule.hooks import filled, run_hook


def test_places_are_filled_and_nothing_that_was_put_in_is_looked_at_again() -> None:
    told = {"run": "runs/{exit_code}", "exit_code": "3"}
    assert filled(["notify", "{run}: {exit_code}{"], told) == ["notify", "runs/{exit_code}: 3{"]
    assert filled(["{unknown} {run.__class__}"], told) == ["{unknown} {run.__class__}"]


@given(word=st.text(), value=st.text())
def test_no_word_becomes_two_and_none_fails(word: str, value: str) -> None:
    assert len(filled([word], {"run": value})) == 1


def test_a_hook_gets_its_words_as_they_are(tmp_path: Path) -> None:
    out = tmp_path / "out"
    program = "import sys, pathlib; pathlib.Path(sys.argv[1]).write_text(sys.argv[2])"
    words = [sys.executable, "-c", program, str(out), "{entry}"]
    assert run_hook(words, {"entry": "$(touch /tmp/x); `id` | cat"}) == ""
    assert out.read_text() == "$(touch /tmp/x); `id` | cat"


def test_what_goes_wrong_is_reported_in_a_line() -> None:
    assert run_hook(["/no/such/hook"], {}) == "hook /no/such/hook: No such file or directory"
    failing = [sys.executable, "-c", "import sys; sys.exit('no network')"]
    assert run_hook(failing, {}).endswith("exit code 1 no network")
    sleeping = [sys.executable, "-c", "import time; time.sleep(60)"]
    assert "took more than 0.2 s" in run_hook(sleeping, {}, timeout_s=0.2)
