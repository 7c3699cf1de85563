"""numba's `njit`, for all that keeps what it compiles: where that is kept is settled first."""

from .compile_cache import use_compile_cache

use_compile_cache()

from numba import njit as njit  # noqa: E402 (reads at its import where compiled code is kept)
