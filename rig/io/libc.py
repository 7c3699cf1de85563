"""The C library's socket calls, for compiled code that must not hold the interpreter's lock.

With the compiler switched off (NUMBA_DISABLE_JIT) the same names call the library by ctypes, so
that the functions built on them run as plain Python too. Addresses are passed as integers
(`array.ctypes.data`), structures as the int64 words they are made of on 64-bit Linux.
"""

import ctypes
from typing import Any, Final

import numpy as np
from numba import types
from numba.core import cgutils, config
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import carray

from rig.jit import njit

MSG_DONTWAIT: Final = 0x40
MSG_NOSIGNAL: Final = 0x4000
POLLIN: Final = 0x1
EINTR: Final = 4
EAGAIN: Final = 11
# Values of Linux on every architecture with a generic ABI (uapi/asm-generic), time ids of time.h.
_CLOCK_MONOTONIC: Final = 1
_SECOND: Final = 1_000_000_000

_COMPILED: Final = not vars(config)["DISABLE_JIT"]
_LIBRARY: Final = ctypes.CDLL(None, use_errno=True)
_C_TYPES: Final = {
    "int32": ctypes.c_int32,
    "int64": ctypes.c_int64,
    "uintp": ctypes.c_size_t,
}


def bind(name: str, result: str, *arguments: str) -> Any:
    """Return a function of the C library that compiled code, or Python without JIT, can call.

    Args:
        name: name of the function in the library.
        result: numba's name of the type of its result, such as "int32".
        arguments: numba's names of the types of its arguments; addresses are "uintp".
    """
    if _COMPILED:
        signature = getattr(types, result)(*(getattr(types, argument) for argument in arguments))
        return types.ExternalFunction(name, signature)
    function = _LIBRARY[name]
    function.restype = _C_TYPES[result]
    function.argtypes = [_C_TYPES[argument] for argument in arguments]
    return function


_send = bind("send", "int64", "int32", "uintp", "uintp", "int32")
_recv = bind("recv", "int64", "int32", "uintp", "uintp", "int32")
_ppoll = bind("ppoll", "int32", "uintp", "uintp", "uintp", "uintp")
_clock_gettime = bind("clock_gettime", "int32", "int32", "uintp")

_SCRATCH: Final = 3


def _on_stack(typing_context: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = context.make_array(signature.return_type)(context, builder)
        count, size = (context.get_constant(types.intp, number) for number in (_SCRATCH, 8))
        memory = cgutils.alloca_once(builder, context.get_value_type(types.int64), size=count)
        populate_array(words, memory, [count], [size], size, None)
        return words._getvalue()

    return types.Array(types.int64, 1, "C")(), emit


def _on_heap() -> Any:
    return np.empty(_SCRATCH, np.int64)


scratch: Any = intrinsic(_on_stack) if _COMPILED else _on_heap
"""Return int64 (3,), not initialised, for a structure.

Compiled code gets it on the stack of the calling function, so that nothing is allocated.
"""

_errno_location: Any = types.ExternalFunction("__errno_location", types.CPointer(types.int32)())


@njit(cache=True, error_model="numpy", nogil=True)
def _library_errno():
    return carray(_errno_location(), 1)[0]


errno: Any = _library_errno if _COMPILED else ctypes.get_errno
"""Return the error number of the last call that failed (errno.h)."""


@njit(cache=True, error_model="numpy", nogil=True)
def monotonic_ns():
    """Return the time on CLOCK_MONOTONIC in ns."""
    time = scratch()
    _clock_gettime(_CLOCK_MONOTONIC, time.ctypes.data)
    return time[0] * _SECOND + time[1]


@njit(cache=True, error_model="numpy", nogil=True)
def send(fd, data, start, stop):
    """Send as much of `data[start:stop]` (uint8) as is possible without waiting.

    Returns:
        The number of bytes sent; -1 if the call failed, and `errno` says why.
    """
    return _send(fd, data.ctypes.data + start, stop - start, MSG_DONTWAIT | MSG_NOSIGNAL)


@njit(cache=True, error_model="numpy", nogil=True)
def receive(fd, data, start):
    """Receive the bytes that are there into `data[start:]` (uint8), without waiting.

    Returns:
        The number of bytes received; 0 if the other end has closed the connection; -1 if the call
        failed or no byte was there, and `errno` says which.
    """
    return _recv(fd, data.ctypes.data + start, data.size - start, MSG_DONTWAIT)


@njit(cache=True, error_model="numpy", nogil=True)
def wait_readable(fd, deadline_ns):
    """Wait until `fd` can be read or has failed, and return True; return False at the deadline.

    It returns False as well if waiting is not possible. A signal does not end the wait.

    Args:
        fd: descriptor to wait for.
        deadline_ns: time on CLOCK_MONOTONIC in ns.
    """
    # struct timespec, then struct pollfd: int fd, short events, short revents (little-endian).
    words = scratch()
    while True:
        left = max(deadline_ns - monotonic_ns(), 0)
        words[0], words[1] = left // _SECOND, left % _SECOND
        words[2] = fd | POLLIN << 32
        ready = _ppoll(words.ctypes.data + 16, 1, words.ctypes.data, 0)
        if ready > 0:
            return True
        if ready == 0 or errno() != EINTR:
            return False
