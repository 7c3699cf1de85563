"""Fuzzes a target with atheris, which is guided by the branches that an input takes.

Finds are written to the target's folder: the input, and what is wrong in a file beside it with
`.txt` added. An input that hangs, or takes too much memory, ends the process; libFuzzer then leaves
it as `timeout-...` or `oom-...`.
"""

import hashlib
import importlib
import os
import pkgutil
import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NoReturn

import atheris

from .guides import GUIDES
from .target import MOST_BYTES, Target, resident_bytes, scratch, tried

ROOT: Final = Path(__file__).parents[2]
HANG_S: Final = 60
"""s by the wall clock after which an input is said to hang. What takes 5 s of the processor's time
is noticed when it ends (`SLOW_S`); the rest is for a machine that does other things, too."""
_LONGEST_WORD: Final = 40
_MOST_WORDS: Final = 400
_WORD: Final = re.compile(rb"[A-Za-z_][A-Za-z0-9_]{2,}|[-+]?[0-9][0-9.e+-]*")


def load() -> dict[str, Target]:
    """Load the product, with the packages instrumented that guide the search; return all targets.

    Nothing of the product may have been imported before but what `target.py` needs.
    """
    guides = list(dict.fromkeys(package for each in GUIDES.values() for package in each))
    tops = list(dict.fromkeys(package.partition(".")[0] for package in guides))
    exclude = [name for name in _modules_of_product() if not _is_in(name, guides)]
    with atheris.instrument_imports(include=tops, exclude=exclude, enable_loader_override=False):
        for package in guides:
            _import_all(package)
    from .targets import TARGETS

    return TARGETS


def fuzz(target: Target, folder: Path, seconds: float, seed: int) -> NoReturn:
    """Fuzz a target for some time, and end this process, which was forked for that.

    Its output goes to `log.txt` in the folder.
    """
    log = os.open(folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    for stream in (1, 2):
        os.dup2(log, stream)
    tempfile.tempdir = str(folder)
    scratch.cache_clear()
    from .targets import corpus_of

    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)
    begun = corpus_of(target)
    for data in begun:
        (corpus / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
        # Whatever is loaded or compiled at first use is no fault of the input that comes first.
        tried(target, data)
    words = folder / "words.dict"
    words.write_text(dictionary(begun))
    seen: set[str] = set()

    def once(data: bytes) -> None:
        find = tried(target, data)
        if find is not None and (find.place or find.what) not in seen:
            seen.add(find.place or find.what)
            keep(folder, data, str(find))

    memory = (resident_bytes() + MOST_BYTES) >> 20
    atheris.Setup(
        [
            target.name, str(corpus), f"-dict={words}", f"-max_total_time={max(seconds, 1):.0f}",
            f"-seed={seed}", f"-timeout={HANG_S}", f"-rss_limit_mb={memory}",
            f"-max_len={target.most}", f"-artifact_prefix={folder}/", "-print_final_stats=1",
            "-verbosity=1",
        ],
        once,
    )  # fmt: skip
    atheris.Fuzz()
    os._exit(0)


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


def _modules_of_product() -> Iterator[str]:
    """Yield the names of all modules of the product, which may have compiled functions."""
    for top in ("rig", "estimator", "control", "faults"):
        for path in (ROOT / top).rglob("*.py"):
            yield ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _is_in(name: str, packages: Iterable[str]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _import_all(package: str) -> None:
    module = importlib.import_module(package)
    for found in pkgutil.walk_packages(getattr(module, "__path__", []), f"{package}."):
        importlib.import_module(found.name)
