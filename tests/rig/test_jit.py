"""What this project changes in numba makes compiling faster and leaves results alone."""

import re
from typing import Any

import numpy as np
import pytest
from numba import float64, njit
from numba.core import types
from numba.core.codegen import CPUCodeLibrary
from numba.core.typing.templates import _OverloadFunctionTemplate

import rig.jit


def of_all_functions(self: Any, module: Any) -> None:
    """Optimise all functions of an LLVM module, declarations too, as numba does by itself."""
    module.data_layout = self._codegen._data_layout
    for function in module.functions:
        passes, builder = self._codegen._function_pass_manager()
        passes.run(function, builder)


def machine_code() -> str:
    """Compile a function that calls others, allocates and may fail; return its machine code.

    Numba numbers what it compiles; these numbers are left out, as they differ each time.
    """

    @njit(error_model="numpy")
    def scaled(values: Any, factor: float) -> Any:
        found = np.empty(values.size)
        for i in range(values.size):
            if values[i] < 0.0:
                raise ValueError("negative")
            found[i] = np.sqrt(values[i]) * factor
        return found

    scaled(np.ones(3), 2.0)
    (code,) = scaled.inspect_asm().values()
    return re.sub(r"B\d+v\d+|v\d+B\d+|0x[0-9a-f]+|\b\d{6,}\b", "", str(code))


def test_leaving_declarations_out_changes_no_machine_code(monkeypatch: pytest.MonkeyPatch) -> None:
    assert CPUCodeLibrary._optimize_functions is rig.jit._optimise_functions
    here = machine_code()
    monkeypatch.setattr(CPUCodeLibrary, "_optimize_functions", of_all_functions)
    there = machine_code()
    assert len(here.splitlines()) > 50
    assert here == there


@rig.jit.njit(error_model="numpy")
def assigned(target: Any, source: Any) -> None:
    target[:] = source


def test_an_array_of_another_size_is_not_assigned_to_a_slice() -> None:
    target = np.zeros(3)
    with pytest.raises(ValueError, match="cannot assign slice from input of different size"):
        assigned(target, np.ones(2))
    assert target.tolist() == [0.0, 0.0, 0.0]
    assigned(target, np.ones(3))
    assert target.tolist() == [1.0, 1.0, 1.0]


def smoothed(values: Any, level: float) -> Any:
    """Call functions that numba defines in Python: they are parts of the function that calls."""
    found = np.zeros(values.size)
    for i in range(values.size):
        found[i] = max(min(values[i] / 3.0, level), -level) + np.empty(i).size
    return found


def test_what_numba_defines_in_python_gives_the_same_bits_as_a_part(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    values = np.random.default_rng(1).standard_normal(40)
    here = rig.jit.njit(smoothed)(values, 0.3)
    monkeypatch.setattr(_OverloadFunctionTemplate, "_get_jit_decorator", rig.jit._decorate)
    assert here.tobytes() == njit(smoothed)(values, 0.3).tobytes()


def test_a_function_with_a_signature_may_be_an_argument_of_a_compiled_one() -> None:
    signature = float64(float64)
    doubled = rig.jit.njit(signature)(lambda x: 2.0 * x)

    @rig.jit.njit(float64(types.FunctionType(signature), float64))
    def twice(function: Any, x: float) -> float:
        return float(function(function(x)))

    assert twice(doubled, 3.0) == 12.0
