"""This module gives numba's `njit`, after the folder for compiled code has been set."""

from .compile_cache import use_compile_cache

use_compile_cache()

from numba import njit as njit  # noqa: E402 (reads at its import where compiled code is kept)
