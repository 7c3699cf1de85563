"""A plant that a user describes in Python is loaded here, with the values of its model file."""

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from estimator.gap import Plant, PlantDescription, PlantError
from rig.configuration.reading import ConfigError, Problem, display_path, suggestion

from .plant_file import PlantModel, read_plant_file, write_plant_file

_EXAMPLE = "give a module and an object of it, as in axis:axis (docs/another_plant.md)"


def load_plant(
    reference: str, model: str | Path | None, recordings: Sequence[str | Path] = ()
) -> PlantModel:
    """Return a plant that a user describes in Python, with the values of a model file.

    The module is imported, which runs its code. The function `write` of the returned plant writes a
    model file of the same form.

    Args:
        reference: `module:object`, looked for in the working folder first, or `path.py:object`.
        model: path of the model file; None is reported as a problem.
        recordings: paths of the recordings that it is for. If the model file gives no period, the
            plant has one that fits the first of them that can be read; without any, 1 ms.

    Raises:
        PlantError: the module, or the plant it describes, cannot be used.
        ConfigError: lists every problem of the model file.
    """
    path = Path(model) if model is not None else None
    try:
        thing = _object(reference)
        if path is None or not path.is_file():
            given = display_path(path) if path else "none given"
            remedy = "give the YAML file with this plant's parameters"
            limit = "" if path is None else "is not a file" if path.exists() else "does not exist"
            raise ConfigError([Problem("--model", 0, 0, given, "", limit, remedy)])
        read = read_plant_file(path, thing, recordings)
    except PlantError as error:
        problems = [f"--plant {reference}: {each}" for each in error.problems]
        raise PlantError(problems) from error.__cause__

    def write(values: Any, effects: tuple[str, ...], provenance: Any, target: Any) -> None:
        write_plant_file(read, values, effects, provenance, Path(target))

    return replace(read, plant=replace(read.plant, write=write))


def _object(reference: str) -> PlantDescription | Plant:
    """Import the module and return the plant or description that a reference names.

    Raises:
        PlantError: the module cannot be imported, or has no such object.
    """
    source, _, name = reference.rpartition(":")
    if not source or not name:
        raise PlantError([f"names no object of a module; {_EXAMPLE}"])
    module = _module(source)
    thing = getattr(module, name, None)
    if isinstance(thing, PlantDescription | Plant):
        return thing
    plants = [
        key for key, value in vars(module).items() if isinstance(value, PlantDescription | Plant)
    ]
    if thing is None:
        remedy = suggestion(name, plants, "plants in it")
        raise PlantError([f"{source} has no {name}; {remedy}"])
    wrong = f"{name} is a {type(thing).__name__}"
    raise PlantError([f"{wrong}, must be a PlantDescription (docs/another_plant.md)"])


@contextmanager
def _found_from(folder: Path) -> Iterator[None]:
    """Put a folder first on the import path within the block."""
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))


def _module(source: str) -> ModuleType:
    path = Path(source)
    by_path = source.endswith(".py")
    if by_path and not path.is_file():
        raise PlantError([f"{source} does not exist; check the path"])
    folder = path.resolve().parent if by_path else Path.cwd()
    try:
        with _found_from(folder):
            return _from_path(path) if by_path else importlib.import_module(source)
    except ModuleNotFoundError as error:
        if error.name is not None and error.name in (source, source.split(".")[0]):
            remedy = "go to its folder, or give its path, as in plants/axis.py:axis"
            missing = f"there is no module {error.name} in {folder} or on PYTHONPATH"
            raise PlantError([f"{missing}; {remedy}"]) from None
        raise PlantError([_broken(error)]) from error
    except Exception as error:
        raise PlantError([_broken(error)]) from error


def _from_path(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def _broken(error: Exception) -> str:
    """Return a message on an error that stopped the import of a module, with file and line."""
    if isinstance(error, SyntaxError):
        where = f"{error.filename}:{error.lineno}"
    else:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{frame.filename}:{frame.lineno}"
    return f"{where}: {type(error).__name__}: {error}"
