"""Ordered access to the words that processes share.

A process that load-acquires a value which another process release-stored sees everything that the
other process wrote before that. So a reader that sees the index of a row sees the row as well, even
on processors that reorder stores. With the JIT off (NUMBA_DISABLE_JIT=1) these are ordinary stores
and loads, which x86 does not reorder.
"""

from typing import Any, Final

from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic

from rig.jit import njit

_BYTES: Final = 8
_INTERPRETED: Final = bool(config.DISABLE_JIT)  # type: ignore[attr-defined]


def _word(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return a pointer to an array's element; array and index are the first two `arguments`."""
    kind = signature.args[0]
    array = context.make_array(kind)(context, builder, arguments[0])
    return cgutils.get_item_pointer(context, builder, kind, array, [arguments[1]])


@intrinsic
def _store(typing_context, words, index, value):
    def generate(context, builder, signature, arguments):
        pointer = _word(context, builder, signature, arguments)
        builder.store_atomic(arguments[2], pointer, "release", _BYTES)
        return context.get_dummy_value()

    return types.void(words, types.intp, words.dtype), generate


@intrinsic
def _load(typing_context, words, index):
    def generate(context, builder, signature, arguments):
        pointer = _word(context, builder, signature, arguments)
        return builder.load_atomic(pointer, "acquire", _BYTES)

    return words.dtype(words, types.intp), generate


@njit(cache=True, error_model="numpy", nogil=True)
def store_release(words, index, value):
    """Store `value` (int64) in `words[index]`, visible only after everything written before it."""
    if _INTERPRETED:
        words[index] = value
    else:
        _store(words, index, value)  # type: ignore[call-arg]


@njit(cache=True, error_model="numpy", nogil=True)
def load_acquire(words, index):
    """Return `words[index]` (int64); values that are read afterwards are not older than it."""
    if _INTERPRETED:
        return words[index]
    return _load(words, index)  # type: ignore[call-arg]
