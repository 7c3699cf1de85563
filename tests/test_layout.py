"""The project as handed over: what the lock pins, what the wheel holds, what an import costs."""

import ast
import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
from hatchling.builders.wheel import WheelBuilder

from .conftest import LONGEST

ROOT = Path(__file__).parents[1]
PRODUCT = ("rig", "estimator", "control", "faults")
COMPILED_PACKAGES = (
    "rig/lanes",
    "rig/plant",
    "rig/io",
    "rig/loop",
    "rig/emulator",
    "rig/sweep",
    "control",
    "estimator",
    "tools",
)
COMPILERS = {"njit", "inner", "inlined", "intrinsic", "overload", "overload_attribute"}
SLOW_TO_IMPORT = {"asammdf", "llvmlite", "numba", "pint", "plotly", "pyarrow", "zenoh"}


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.fixture(scope="module")
def wheel_files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("wheel")
    wheel = next(WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"]))
    return zipfile.ZipFile(wheel).namelist()


def canonical(requirement: str) -> str:
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert name is not None
    return re.sub(r"[-_.]+", "-", name[0]).lower()


def locked_in(name: str) -> set[str]:
    """Return the pins of a lock, `package==version`, of those that have hashes."""
    return set(re.findall(r"^(\S+==\S+).*\\\n    --hash=", (ROOT / name).read_text(), re.M))


def grouped(project: dict[str, Any], group: str) -> set[str]:
    entries = project["dependency-groups"][group]
    return {canonical(entry) for entry in entries if isinstance(entry, str)}


def test_every_declared_dependency_is_locked_with_its_hashes(project: dict[str, Any]) -> None:
    declared = {canonical(entry) for entry in project["project"]["dependencies"]}
    declared |= grouped(project, "build")
    assert declared <= {canonical(pin) for pin in locked_in("requirements-lock.txt")}
    declared |= grouped(project, "dev")
    assert declared <= {canonical(pin) for pin in locked_in("requirements-dev-lock.txt")}


def test_what_installs_the_rest_is_locked_with_its_hashes(project: dict[str, Any]) -> None:
    pins = {canonical(pin) for pin in locked_in("requirements-install-lock.txt")}
    assert pins == grouped(project, "install")


def test_the_tests_run_with_what_a_demo_runs_with() -> None:
    assert locked_in("requirements-lock.txt") < locked_in("requirements-dev-lock.txt")


def test_a_demo_installs_nothing_that_only_development_needs(project: dict[str, Any]) -> None:
    running = {canonical(pin) for pin in locked_in("requirements-lock.txt")}
    assert running.isdisjoint(grouped(project, "dev") - grouped(project, "build"))
    assert running.isdisjoint({"pandas", "pillow", "lxml"})


@cache
def tree_of(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


@cache
def nodes_of(file: Path) -> list[ast.AST]:
    """Return all nodes of a module, each before those below it."""
    return list(ast.walk(tree_of(file)))


@pytest.fixture(scope="module", autouse=True)
def trees_forgotten() -> Iterator[None]:
    """Drop the trees of all modules after these tests, as they are millions of objects."""
    yield
    nodes_of.cache_clear()
    tree_of.cache_clear()


@cache
def providers() -> Mapping[str, list[str]]:
    return packages_distributions()


def imported_packages(folder: str) -> set[str]:
    """Return the top-level names that the modules of a folder import from elsewhere."""
    found: set[str] = set()
    for file in (ROOT / folder).rglob("*.py"):
        for node in nodes_of(file):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split(".")[0])
    return found - set(PRODUCT) - sys.stdlib_module_names


@pytest.mark.parametrize("folder", PRODUCT)
def test_what_the_product_imports_is_declared(project: dict[str, Any], folder: str) -> None:
    extras = project["project"]["optional-dependencies"].values()
    required = [*project["project"]["dependencies"], *chain.from_iterable(extras)]
    declared = {canonical(name) for name in required}
    undeclared = {
        package
        for package in imported_packages(folder)
        if declared.isdisjoint(canonical(name) for name in providers().get(package, []))
    }
    assert undeclared == set()


def test_the_wheel_holds_the_product_and_nothing_a_developer_runs(wheel_files: list[str]) -> None:
    tops = {name.split("/")[0] for name in wheel_files}
    assert {top for top in tops if not top.endswith(".dist-info")} == set(PRODUCT)


def test_the_wheel_holds_every_shipped_configuration(wheel_files: list[str]) -> None:
    shipped = {
        f"rig/shipped_config/{file.relative_to(ROOT / 'config').as_posix()}"
        for file in (ROOT / "config").rglob("*.yaml")
    }
    assert shipped
    assert shipped <= set(wheel_files)


def test_the_wheel_holds_the_face_of_every_package(wheel_files: list[str]) -> None:
    faces = {
        file.relative_to(ROOT).as_posix()
        for package in PRODUCT
        for file in (ROOT / package).rglob("__init__.pyi")
    }
    assert len(faces) > 30
    assert faces <= set(wheel_files)


def test_no_face_gives_something_the_name_of_a_module_beside_it() -> None:
    # Once that module is imported, it would stand in the other's place.
    hidden = [
        f"{face.relative_to(ROOT)}: {given.name}"
        for package in PRODUCT
        for face in (ROOT / package).rglob("__init__.pyi")
        for node in ast.parse(face.read_text()).body
        if isinstance(node, ast.ImportFrom) and node.module
        for given in node.names
        if any((face.parent / name).exists() for name in (given.name, f"{given.name}.py"))
    ]
    assert hidden == []


@pytest.mark.parametrize("package", ["rig.stream", "rig.recording", "rig.console"])
def test_a_package_that_needs_no_compiler_loads_none_whichever_module_is_used(package: str) -> None:
    folder = ROOT.joinpath(*package.split("."))
    modules = [
        ".".join(file.relative_to(ROOT).with_suffix("").parts) for file in folder.rglob("*.py")
    ]
    assert {"numba", "llvmlite"}.isdisjoint(loaded_by(modules))


def test_the_processes_that_record_and_publish_a_session_load_no_compiler() -> None:
    processes = [f"rig.supervisor.processes.{name}" for name in ("recorder", "publisher", "field")]
    assert {"numba", "llvmlite"}.isdisjoint(loaded_by(processes))


def loaded_by(modules: list[str]) -> set[str]:
    """Return the names of all modules that are loaded once these have been imported."""
    program = f"import sys\nfrom importlib import import_module\nfor name in {modules}:\n"
    found = subprocess.run(
        [sys.executable, "-c", program + "    import_module(name)\nprint(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(found.stdout.split())


def test_the_longest_test_files_are_there_and_begun_with_once() -> None:
    assert [file for file in LONGEST if not (ROOT / "tests" / file).is_file()] == []
    assert len(set(LONGEST)) == len(LONGEST)


@pytest.mark.parametrize("module", ["rig", "rig.cli"])
def test_a_quick_start_loads_neither_compiler_nor_plots_nor_tables(module: str) -> None:
    found = subprocess.run(
        [sys.executable, "-c", f"import {module}, sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert SLOW_TO_IMPORT.isdisjoint(found.stdout.split())


def unannotated(node: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield the functions below `node` that lack an annotation, past those that numba compiles."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            names = [ast.unparse(decorator).split("(")[0] for decorator in child.decorator_list]
            decorators = {name.rsplit(".")[-1] for name in names}
            if decorators & COMPILERS:
                continue
            arguments = [*child.args.posonlyargs, *child.args.args, *child.args.kwonlyargs]
            bare = [a for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
            if bare or child.returns is None:
                yield child
        yield from unannotated(child)


@pytest.mark.parametrize("package", COMPILED_PACKAGES)
def test_every_function_that_is_not_compiled_is_annotated(package: str) -> None:
    found = [
        f"{file.relative_to(ROOT)}:{function.lineno} {function.name}"
        for file in sorted((ROOT / package).rglob("*.py"))
        for function in unannotated(tree_of(file))
    ]
    assert found == []


def called_uncompiled(node: ast.AST, parts: set[str]) -> Iterator[str]:
    """Yield the parts that functions below `node` call which numba does not compile."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef):
            decorators = [ast.unparse(each).split("(")[0] for each in child.decorator_list]
            if {name.rsplit(".")[-1] for name in decorators} & COMPILERS:
                continue
        if isinstance(child, ast.Call) and isinstance(child.func, ast.Name):
            yield from {child.func.id} & parts
        yield from called_uncompiled(child, parts)


def parts_known_to(file: Path, parts: dict[str, set[Path]]) -> set[str]:
    """Return the names of parts that a module defines or imports, by way of a face or not."""
    known = {name for name, places in parts.items() if file in places}
    for node in nodes_of(file):
        if isinstance(node, ast.ImportFrom):
            start = file.parents[node.level - 1] if node.level else ROOT
            source = start.joinpath(*(node.module or "").split("."))
            known |= {
                alias.asname or alias.name
                for alias in node.names
                for where in parts.get(alias.name, ())
                if where.with_suffix("").is_relative_to(source)
            }
    return known


def test_what_only_compiled_code_may_call_is_called_by_nothing_else() -> None:
    files = {
        file: file.read_text()
        for folder in (*PRODUCT, "tools", "tests")
        for file in (ROOT / folder).rglob("*.py")
    }
    parts: dict[str, set[Path]] = {}
    for file in (file for file, text in files.items() if re.search(r"@(inner|inlined)\b", text)):
        for node in nodes_of(file):
            if isinstance(node, ast.FunctionDef):
                decorators = {ast.unparse(each) for each in node.decorator_list}
                if decorators & {"inner", "inlined"}:
                    parts.setdefault(node.name, set()).add(file)
    assert len(parts) > 50
    # Called from Python, a part ends the process: it has nothing that Python could call it by.
    named = re.compile(rf"\b({'|'.join(parts)})\b")
    known = {
        file: parts_known_to(file, parts) for file, text in files.items() if named.search(text)
    }
    found = {
        f"{file.relative_to(ROOT)}: {name}"
        for file, names in known.items()
        if names
        for name in called_uncompiled(tree_of(file), names)
    }
    assert found == set()
