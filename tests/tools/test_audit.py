"""The audit takes nothing for sound that it has not looked at."""

from typing import Any

import pytest

from tools.audit import (
    FINE,
    FOUND,
    LOCK,
    NOT_AUDITED,
    is_allowed,
    licences,
    materials,
    pinned,
    vulnerabilities,
)

SOUND = {"name": "Click", "version": "8.1", "vulns": []}
FLAWED = {"name": "lz4", "version": "4.3", "vulns": [{"id": "CVE-1", "fix_versions": ["4.4"]}]}
UNSEEN = {"name": "numpy", "skip_reason": "not found"}


@pytest.mark.parametrize(
    ("reported", "code", "said"),
    [
        ([SOUND], FINE, "no known vulnerability in 1 packages"),
        ([SOUND, FLAWED], FOUND, "lz4 4.3: CVE-1, fixed in 4.4"),
        ([SOUND, UNSEEN], NOT_AUDITED, "not audited: 1 of 2 packages"),
        ([FLAWED, UNSEEN], FOUND, "not audited: 1 of 2"),
        ([], NOT_AUDITED, "not audited"),
    ],
)
def test_what_was_not_looked_up_is_not_taken_for_sound(
    reported: list[dict[str, Any]], code: int, said: str
) -> None:
    found, lines = vulnerabilities({"dependencies": reported}, ["click", "lz4", "numpy"])
    assert found == code
    assert any(said in line for line in lines)


@pytest.mark.parametrize(
    ("licence", "allowed"),
    [
        ("MIT", True),
        ("Apache-2.0 OR GPL-3.0-only", True),
        ("BSD-2-Clause AND Apache-2.0 WITH LLVM-exception", True),
        ("MIT AND GPL-3.0-only", False),
        ("Mozilla Public License 2.0 (MPL 2.0)", True),
        ("MIT AND (GPL-3.0-only OR Zlib)", True),
        ("AGPL-3.0-or-later", False),
    ],
)
def test_a_licence_is_allowed_by_all_of_its_parts(licence: str, allowed: bool) -> None:
    assert is_allowed(licence) is allowed


def test_a_licence_that_is_refused_or_not_named_is_told_with_what_to_do() -> None:
    named = [{"name": "a", "version": "1", "licenses": [{"license": {"id": "MIT"}}]}]
    classified = {"license": {"name": "License :: OSI Approved :: BSD License"}}
    assert licences([*named, {"name": "b", "licenses": [classified]}])[0] == FINE
    viral = {"name": "d", "version": "3", "licenses": [{"expression": "GPL-3.0-only"}]}
    code, lines = licences([{"name": "c", "version": "2"}, viral])
    assert code == FOUND
    assert lines[0].startswith("c 2: licence none named; look at it")
    assert lines[1].startswith("d 3: licence GPL-3.0-only")


def test_the_bill_has_what_is_pinned_and_what_it_depends_on() -> None:
    bill = {
        "components": [{"name": "Zstandard", "bom-ref": "z"}, {"name": "pytest", "bom-ref": "p"}],
        "dependencies": [{"ref": "z", "dependsOn": ["p"]}, {"ref": "p"}],
    }
    kept = materials(bill, {"zstandard": "0.25"})
    assert kept["components"] == [{"name": "Zstandard", "bom-ref": "z"}]
    assert kept["dependencies"] == [{"ref": "z", "dependsOn": []}]


def test_every_pin_of_the_lock_is_known_with_its_version() -> None:
    known = pinned(LOCK.read_text())
    assert {"numpy", "python-can", "eclipse-zenoh"} <= set(known)
    assert known["pymodbus"].startswith("3.16")
