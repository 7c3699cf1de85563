"""The code by which a device stores numbers in registers of 16 bits."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from struct import pack, unpack
from typing import Final, Literal

from rig.io import WORDS, Register, RegisterType, RegisterValue

_FORMATS: Final = {"U16": ">H", "I16": ">h", "U32": ">I", "I32": ">i", "F32": ">f"}
_RANGES: Final = {
    "U16": (0, 0xFFFF),
    "I16": (-0x8000, 0x7FFF),
    "U32": (0, 0xFFFF_FFFF),
    "I32": (-0x8000_0000, 0x7FFF_FFFF),
}


@dataclass(frozen=True)
class RegisterCode:
    """Converts numbers to the contents of registers, and back.

    Attributes:
        word_order: order of the two words of a number of 32 bits.
    """

    word_order: Literal["high_first", "low_first"]

    def number(self, address: int, kind: RegisterType, words: Mapping[int, int]) -> float:
        """Return the number of type `kind` at `address`, given the registers' words by address."""
        halves = [words[at].to_bytes(2, "big") for at in range(address, address + WORDS[kind])]
        return float(unpack(_FORMATS[kind], b"".join(self._ordered(halves)))[0])

    def words(self, address: int, kind: RegisterType, number: float) -> dict[int, int]:
        """Return the words of a number by address; unless F32, it is rounded and kept in range."""
        if kind != "F32":
            low, high = _RANGES[kind]
            number = min(max(round(number), low), high)
        data = pack(_FORMATS[kind], number)
        halves = self._ordered([data[i : i + 2] for i in range(0, len(data), 2)])
        return {address + i: int.from_bytes(half, "big") for i, half in enumerate(halves)}

    def _ordered(self, halves: list[bytes]) -> Iterable[bytes]:
        return halves if self.word_order == "high_first" else halves[::-1]


def addresses(register: Register | RegisterValue) -> range:
    """Return the addresses of the one or two registers that a number takes."""
    return range(register.address, register.address + WORDS[register.type])
