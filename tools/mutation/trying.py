"""Tries mutants: a forked process imports each in the module's place, and runs the tests."""

import ast
import importlib.abc
import importlib.util
import os
import resource
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Final

import pytest

CPU_S: Final = 30
"""Processor time, s, after which a mutant counts as noticed, because it does not end."""
_PREPARED: Final = (
    "hypothesis", "numpy", "pytest", "numba", "lazy_loader", "control", "faults", "rig.io.signals",
    "rig.io.settings", "rig.io.limits", "rig.io.simulated", "rig.plant.dynamics",
    "rig.plant.integrator", "rig.plant.sensors",
)  # fmt: skip
"""Modules that the tests need and that know nothing of the mutated ones: imported once."""


class _Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module from a given syntax tree."""

    def __init__(self, name: str, path: Path, tree: ast.Module) -> None:
        self._name, self._path, self._tree = name, path, tree

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._name:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        exec(compile(self._tree, str(self._path), "exec"), vars(module))


class Trial:
    """A plugin of pytest that forks a process for each mutant before tests are collected.

    So pytest is set up once for all. The processes collect and run the tests, each with its mutant;
    this one waits for them, and runs no test.

    Args:
        module: name of the mutated module.
        path: its file.
        trees: the syntax trees to import in its place.
        found: is called with the number of a tree, and whether a test failed or none could run.
    """

    def __init__(
        self,
        module: str,
        path: Path,
        trees: Iterable[ast.Module],
        found: Callable[[int, bool], None],
    ) -> None:
        self._module, self._path, self._trees, self._found = module, path, trees, found

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> object:
        """Fork; return None in a child, which goes on, and an answer here, where nothing is run.

        Raises:
            RuntimeError: the module has been imported already.
        """
        if self._module in sys.modules:
            raise RuntimeError(f"{self._module} was imported before its mutants")
        for number, tree in enumerate(self._trees):
            child = os.fork()
            if child == 0:
                resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
                self._trees = ()
                sys.meta_path.insert(0, _Mutated(self._module, self._path, tree))
                self._is_child = True
                return None
            _, status = os.waitpid(child, 0)
            self._found(number, status != 0)
        session.items = []
        return session.items

    _is_child = False

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        """End a child here, without what pytest would do in its parent's name."""
        if self._is_child:
            os._exit(int(exitstatus))


def prepare() -> None:
    """Import what all tests need, once for all mutants.

    Raises:
        RuntimeError: the JIT is on, which would compile every mutant.
    """
    if not os.environ.get("NUMBA_DISABLE_JIT"):
        raise RuntimeError("the JIT is on: set NUMBA_DISABLE_JIT=1")
    # Examples of Hypothesis are then the same for each mutant.
    os.environ["CI"] = "1"
    for name in _PREPARED:
        importlib.import_module(name)


def try_all(
    module: str,
    path: Path,
    trees: Iterable[ast.Module],
    tests: Sequence[str],
    found: Callable[[int, bool], None],
) -> None:
    """Run tests with each of several syntax trees in a module's place; see `Trial`.

    Args:
        module: name of the mutated module.
        path: its file.
        trees: the syntax trees to import in its place.
        found: is called with the number of a tree, and whether a test noticed.
        tests: files of tests, in the order in which they are run until one fails.
    """
    options = ("-x", "-q", "--tb=no", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist")
    told, errors = os.dup(1), os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)

    def say(number: int, noticed: bool) -> None:
        os.dup2(told, 1)
        found(number, noticed)
        sys.stdout.flush()
        os.dup2(silent, 1)

    sys.stdout.flush()
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    try:
        pytest.main([*options, "--capture=no", *tests], [Trial(module, path, trees, say)])
    finally:
        os.dup2(told, 1)
        os.dup2(errors, 2)
