"""Which changes are tried, and how a mutant reaches the tests."""

import ast
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tools.mutation.harmless import HARMLESS
from tools.mutation.mutants import Mutant, mutants_of
from tools.mutation.subjects import ROOT, SUBJECTS

SOURCE = '''"""A docstring with 3 numbers."""
import math

LIMIT: Final = 2.5

def judge(value: int = 3, known=()):
    """Another."""
    if value > LIMIT and not known:
        memory[0] = abs(value) - 1
    return Cause.TRIPPED if value in known else _TRIP

ROWS = (row(A), row(B))
'''


def changes(source: str = SOURCE) -> list[str]:
    return [mutant.name for mutant in mutants_of(source)]


def test_each_operator_number_call_branch_and_row_is_changed_once() -> None:
    assert changes() == [
        "LIMIT: `2.5` -> `5.0`",
        "judge: `3` -> `4`",
        "judge: `value > LIMIT and (not known)` -> `value > LIMIT or not known`",
        "judge: `value > LIMIT` -> `value >= LIMIT`",
        "judge: `value > LIMIT` -> `value < LIMIT`",
        "judge: `not known` -> `known`",
        "judge: `memory[0] = abs(value) - 1` -> `pass`",
        "judge: `0` -> `1`",
        "judge: `abs(value) - 1` -> `abs(value) + 1`",
        "judge: `abs(value)` -> `float(value)`",
        "judge: `1` -> `2`",
        "judge: `Cause.TRIPPED if value in known else _TRIP` -> "
        "`_TRIP if value in known else Cause.TRIPPED`",
        "judge: `value in known` -> `value not in known`",
        "judge: `Cause.TRIPPED` -> `Cause.LIMIT_LOW`",
        "judge: `_TRIP` -> `_INDICATE`",
        "ROWS: without `row(A)`",
        "ROWS: without `row(B)`",
    ]


def test_a_mutant_differs_from_the_module_in_one_place_and_keeps_it_as_it_was() -> None:
    original = ast.unparse(ast.parse(SOURCE)).splitlines()
    for mutant in mutants_of(SOURCE):
        changed = ast.unparse(mutant.tree).splitlines()
        assert sum(a != b for a, b in zip(original, changed, strict=True)) == 1, mutant.name
        compile(mutant.tree, "x", "exec")


def test_texts_types_and_imports_are_left_alone() -> None:
    assert changes('"""Text."""\nimport a\nx: int\nNAME = "text"\nf"{NAME}"\n') == []


def test_a_mutant_is_named_without_its_line_which_moves() -> None:
    (mutant,) = mutants_of("\n\nWIDTH = 2\n")
    assert isinstance(mutant, Mutant)
    assert (mutant.line, mutant.name) == (3, "WIDTH: `2` -> `3`")


def test_places_with_the_same_words_are_told_apart_by_their_number() -> None:
    names = [mutant.name for mutant in mutants_of("def f():\n    g(2)\n    h(2)\n")]
    assert [name for name in names if "`2`" in name] == ["f: `2` -> `3`", "f: `2` -> `3` (2)"]


def test_the_code_that_keeps_the_rig_safe_has_tests_that_are_there() -> None:
    assert [subject.name for subject in SUBJECTS] == [
        "interlock", "plausibility", "states", "ladder",
    ]  # fmt: skip
    for subject in SUBJECTS:
        assert subject.path.is_file()
        assert all((ROOT / test).is_file() for test in subject.tests)


def test_what_does_not_matter_is_a_mutant_that_there_is_and_has_a_reason() -> None:
    known = Counter(
        mutant.name for subject in SUBJECTS for mutant in mutants_of(subject.path.read_text())
    )
    # A reason for one place excuses no other one.
    assert [known[name] for name in HARMLESS] == [1] * len(HARMLESS)
    assert all(reason.endswith(".") for reason in HARMLESS.values())


@pytest.mark.long
def test_a_mutant_that_tests_see_is_noticed_and_another_survives(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text("def law(x):\n    return x + 1 if x > 5 else 0 + 0\n")
    (tmp_path / "test_law.py").write_text(
        "from law import law\ndef test_it():\n    assert law(9) == 10\n    assert law(2) == 0\n"
    )
    program = (
        "import ast, sys\n"
        "from pathlib import Path\n"
        "from tools.mutation.mutants import mutants_of\n"
        "from tools.mutation.trying import try_all\n"
        f"path = Path({str(tmp_path / 'law.py')!r})\n"
        f"sys.path.insert(0, {str(tmp_path)!r})\n"
        "trees = [ast.parse(path.read_text()), *(m.tree for m in mutants_of(path.read_text()))]\n"
        f"test = {str(tmp_path / 'test_law.py')!r}\n"
        "try_all('law', path, trees, [test], lambda n, seen: print(n, seen))\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    told = dict(line.split() for line in found.stdout.splitlines())
    assert told["0"] == "False"
    assert set(told.values()) == {"True", "False"}
