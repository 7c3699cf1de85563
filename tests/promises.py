"""What docs/safety.md and docs/stream.md promise, and which tests hold them to it.

A promise is a paragraph, an item of a list or a row of a table. `docs/promises.yaml` lists each by
its first words, with the names of its tests, or with the reason why it has none. A row that names
its tests itself needs no entry. The rows of a table that a program writes are one promise.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import yaml

ROOT = Path(__file__).parents[1]
PAGES = ("safety.md", "stream.md")
LISTED = ROOT / "docs" / "promises.yaml"


class Promise(NamedTuple):
    """One promise of a page, in its words."""

    page: str
    text: str

    @property
    def own_tests(self) -> list[str]:
        """Names of the tests that its text names."""
        return re.findall(r"`(test_\w+)`", self.text)


def promises_of(page: str, text: str) -> Iterator[Promise]:
    """Yield the promises in a page's text, without its headings, code and formulas."""
    text = re.sub(r"```.*?```|\$\$.*?\$\$", "", text, flags=re.DOTALL)
    written = re.compile(r"<!-- (table of \w+) -->.*?<!-- end -->", re.DOTALL)
    for name in written.findall(text):
        yield Promise(page, name)
    for block in re.split(r"\n\s*\n", written.sub("", text)):
        if block.startswith("    "):
            continue  # code
        lines = [line for line in block.strip().splitlines() if not line.startswith("#")]
        rows = [line for line in lines if line.startswith("|")]
        # The first two lines of a table are its head.
        yield from (Promise(page, row) for row in rows[2:])
        others = "\n".join(line.strip() for line in lines if not line.startswith("|"))
        for item in re.split(r"\n(?=- )", others):
            if item.strip():
                yield Promise(page, " ".join(item.split()))


def all_promises() -> list[Promise]:
    """Return the promises of all pages."""
    texts = {page: (ROOT / "docs" / page).read_text(encoding="utf-8") for page in PAGES}
    return [promise for page, text in texts.items() for promise in promises_of(page, text)]


class Entry(NamedTuple):
    """What the list says of the promise that begins with these words."""

    page: str
    begins: str
    tests: list[str]
    without: str


def entries(text: str) -> list[Entry]:
    """Return the entries of a list of promises."""
    return [
        Entry(page, each["begins"], each.get("tests", []), each.get("without", ""))
        for page, listed in yaml.safe_load(text).items()
        for each in listed
    ]


def written_tests() -> set[str]:
    """Return the names of all tests of this checkout."""
    return {
        name
        for file in Path(__file__).parent.rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
    }


def problems(promises: list[Promise], listed: list[Entry], written: set[str]) -> list[str]:
    """Return a sentence on each promise without a test, and on each entry that leads nowhere."""
    found = []
    for promise in promises:
        about = [e for e in listed if e.page == promise.page and promise.text.startswith(e.begins)]
        named = [name for entry in about for name in entry.tests] + promise.own_tests
        if not named and not any(entry.without for entry in about):
            found.append(f"{promise.page}: no test is named of {promise.text[:70]!r}")
        found += [
            f"{promise.page}: {name} does not exist, which is to hold {promise.text[:70]!r}"
            for name in named
            if name not in written
        ]
    for entry in listed:
        fits = [p for p in promises if p.page == entry.page and p.text.startswith(entry.begins)]
        if len(fits) != 1:
            found.append(f"{entry.page}: {len(fits)} promises begin with {entry.begins!r}, not one")
        if bool(entry.tests) == bool(entry.without):
            found.append(f"{entry.page}: {entry.begins!r} needs `tests` or `without`, one of them")
    return found
