"""The views of all rigs that a reader hears, of which there are never more than a bound.

Whoever may publish on the stream may invent names of rigs without end.
"""

from collections.abc import Iterator
from typing import Final

from .known import UnknownRigError
from .messages import MessageError
from .view import RigView

MOST_RIGS: Final = 256
"""Most rigs of which a reader keeps what they say; a view of an invented one takes some kB."""


class HeardRigs:
    """A collection of the views of the rigs that were heard, by their ids; it is not thread-safe.

    Args:
        window_s: how long in s the views store samples after their arrival.
    """

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._views: dict[str, RigView] = {}

    def __iter__(self) -> Iterator[RigView]:
        """Return the views, by the rigs' ids in alphabetical order."""
        return iter([self._views[rig] for rig in sorted(self._views)])

    def get(self, rig: str) -> RigView | None:
        """Return the view of a rig; None if it is not known."""
        return self._views.get(rig)

    def known(self, rig: str | None) -> RigView:
        """Return the view of a rig; without an id, that of the only known rig.

        Raises:
            UnknownRigError: the rig is not known; or no id is given and not exactly one is known.
        """
        if rig is None:
            if len(self._views) != 1:
                known = ", ".join(sorted(self._views)) or "none"
                raise UnknownRigError(f"name the rig; known are: {known}")
            return next(iter(self._views.values()))
        if rig not in self._views:
            raise UnknownRigError(f"rig {rig} was not heard of")
        return self._views[rig]

    def of(self, rig: str, now_ns: int, *, is_proven: bool = False) -> RigView:
        """Return the view of a rig, which is made if there is none.

        If there are too many, the one that was silent for longest is forgotten. One that lives goes
        only for a rig that is proven, and one that is proven never goes before others.

        Args:
            rig: the rig's id.
            now_ns: the present time of the clock of the messages' arrival, ns since 1970.
            is_proven: whether the message for which the view is wanted was signed by the rig.

        Raises:
            MessageError: there are too many rigs, all of which are worth more than this one.
        """
        if rig in self._views:
            return self._views[rig]
        if len(self._views) >= MOST_RIGS:
            least = min(self._views.values(), key=lambda view: (view.is_proven, view.heard_ns))
            if (least.is_proven or not least.is_silent(now_ns)) and not is_proven:
                raise MessageError(f"{rig}: is heard beside {MOST_RIGS} others, which are too many")
            del self._views[least.rig]
        self._views[rig] = RigView(rig, self._window_s)
        return self._views[rig]
