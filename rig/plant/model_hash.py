"""The hash by which a model is known, whatever it is called."""

import hashlib
import json
from typing import Any

from .effects import Model


def model_sha256(model: Model) -> str:
    """Return the SHA-256 (hex) of a model's parameters, effects and terms, without its name.

    Knots of tables count only where they are not 0, so that models without tables have the hashes
    that they had before there were tables.
    """
    parameters = {
        name: value
        for name, value in model.parameters._asdict().items()
        if value != 0.0 or not name.startswith("table_")
    }
    content: dict[str, Any] = {"parameters": parameters, "effects": sorted(model.effects)}
    if model.discovered:
        content["discovered"] = model.discovered
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
