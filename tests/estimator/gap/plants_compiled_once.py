"""Lets tests that make the same described plant many times compile its functions once."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import CodeType
from typing import Any
from unittest.mock import patch

from numba.extending import is_jitted

from estimator.gap.plant import compiled_functions


@contextmanager
def plants_compiled_once() -> Iterator[None]:
    """Compile functions of described plants in this context only if they differ from earlier ones.

    They are the same if their generated source and the code of the functions that it calls are, and
    all that this code takes from its modules.
    """
    compile_anew = compiled_functions._made
    made: dict[Any, Any] = {}

    def made_once(name: str, source: str, signature: Any, names: dict[str, Any], of: str) -> Any:
        key = source, *((each, _content(value)) for each, value in names.items())
        if key not in made:
            made[key] = compile_anew(name, source, signature, names, of)
        return made[key]

    with patch.object(compiled_functions, "_made", made_once):
        yield


def _content(value: Any) -> Any:
    """Return what a compiled function depends on of a name that it uses."""
    if isinstance(value, type):
        return value.__name__, getattr(value, "_fields", None)
    function = value.py_func if is_jitted(value) else value
    code = getattr(function, "__code__", None)
    if not isinstance(code, CodeType) or function.__closure__:
        return value
    used = {name: function.__globals__.get(name) for name in code.co_names}
    return code, tuple(used.items())
