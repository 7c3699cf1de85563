"""Texts that an operator gives on the command line, to be kept in records and shown to others."""

from typing import Any, Final

import click


class _Text(click.ParamType[str]):
    """A text; bytes that are none are refused before anything is asked for."""

    name = "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text; the shell's bytes that are no UTF-8 have become lone surrogates."""
        text = str(value)
        try:
            text.encode()
        except UnicodeEncodeError:
            shown = text.encode(errors="replace").decode()
            self.fail(f"{shown}: is no UTF-8; write it in UTF-8", param, ctx)
        return text


TEXT: Final = _Text()
