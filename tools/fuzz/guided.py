"""Fuzzes one target with atheris, which is guided by the branches that an input takes.

Run by `python -m tools.fuzz`, as a process of its own for each target, as
`python -m tools.fuzz.guided TARGET FOLDER SECONDS SEED`. Finds are written to FOLDER: the input,
and what is wrong in a file beside it with `.txt` added. An input that hangs, or takes too much
memory, ends the process; libFuzzer then leaves it as `timeout-...` or `oom-...`.
"""

import hashlib
import importlib
import pkgutil
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import atheris

from .guides import GUIDES
from .target import MOST_BYTES, SLOW_S, resident_bytes, tried

_LONGEST_WORD: Final = 40
_MOST_WORDS: Final = 400
_WORD: Final = re.compile(rb"[A-Za-z_][A-Za-z0-9_]{2,}|[-+]?[0-9][0-9.e+-]*")


def main() -> None:
    """Fuzz the target that the command line names, until its time is over."""
    name, folder, seconds, seed = sys.argv[1], Path(sys.argv[2]), sys.argv[3], sys.argv[4]
    packages = GUIDES[name]
    with atheris.instrument_imports(include=list(packages), enable_loader_override=False):
        for package in packages:
            _import_all(package)
    from .targets import TARGETS, corpus_of

    target = TARGETS[name]
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    begun = corpus_of(target)
    for data in begun:
        (corpus / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
    words = folder / "words.dict"
    words.write_text(dictionary(begun))
    for data in begun:
        # Whatever is loaded or compiled at first use is no fault of the input that comes first.
        tried(target, data)
    seen: set[str] = set()

    def once(data: bytes) -> None:
        find = tried(target, data)
        if find is not None and str(find.place or find.what) not in seen:
            seen.add(str(find.place or find.what))
            keep(folder, data, str(find))

    memory = (resident_bytes() + MOST_BYTES) >> 20
    atheris.Setup(
        [
            sys.argv[0], str(corpus), f"-dict={words}", f"-max_total_time={seconds}",
            f"-seed={seed}", f"-timeout={SLOW_S:.0f}", f"-rss_limit_mb={memory}",
            f"-max_len={target.most}", f"-artifact_prefix={folder}/", "-print_final_stats=1",
            "-verbosity=1",
        ],
        once,
    )  # fmt: skip
    atheris.Fuzz()


def keep(folder: Path, data: bytes, what: str) -> None:
    """Write a find to a folder: the input, and beside it what is wrong."""
    path = folder / f"find-{hashlib.sha256(data).hexdigest()[:16]}"
    path.write_bytes(data)
    path.with_suffix(".txt").write_text(what + "\n")


def dictionary(corpus: Iterable[bytes]) -> str:
    """Return a dictionary of libFuzzer with the words and numbers of inputs."""
    words: dict[bytes, None] = {}
    for data in corpus:
        words |= dict.fromkeys(word[:_LONGEST_WORD] for word in _WORD.findall(data))
    lines = (f'"{word.decode()}"' for word in list(words)[:_MOST_WORDS])
    return "\n".join(lines) + "\n"


def _import_all(package: str) -> None:
    module = importlib.import_module(package)
    for found in pkgutil.walk_packages(getattr(module, "__path__", []), f"{package}."):
        importlib.import_module(found.name)


if __name__ == "__main__":
    main()
