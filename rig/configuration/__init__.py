"""Reads YAML with units into the objects of the layers below: rigs, models, campaigns.

Every mistake of a file is reported at once, with line, value, limit and remedy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .problems import ConfigError, Problem

if TYPE_CHECKING:
    from .campaign import load_campaign
    from .checking import check
    from .lookup import copy_shipped, shipped_config_dir
    from .model import load_model
    from .model_writing import dump_model
    from .rig import Rig, load_rig

__all__ = [
    "ConfigError",
    "Problem",
    "Rig",
    "check",
    "copy_shipped",
    "dump_model",
    "load_campaign",
    "load_model",
    "load_rig",
    "shipped_config_dir",
]

# These need pydantic and the plant, which telling an error's type does not.
_ON_DEMAND = {
    "Rig": "rig",
    "check": "checking",
    "copy_shipped": "lookup",
    "dump_model": "model_writing",
    "load_campaign": "campaign",
    "load_model": "model",
    "load_rig": "rig",
    "shipped_config_dir": "lookup",
}


def __getattr__(name: str) -> Any:
    if name not in _ON_DEMAND:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_ON_DEMAND[name]}", __name__), name)
