"""What this project changes in numba makes compiling faster and leaves the machine code alone."""

import re
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.codegen import CPUCodeLibrary

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
