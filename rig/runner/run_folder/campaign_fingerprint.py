"""What must be the same for a campaign to be resumed: its tests, its rig, and its model."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from faults import Campaign
from rig.configuration import Rig, plain
from rig.runner.outcomes import model_sha256

_YAML: Final = (".yaml", ".yml")


def fingerprint(campaign: Campaign, rig: Rig) -> dict[str, str]:
    """Return the SHA-256 (hex) of campaign, rig and model, by these names.

    Of YAML files what they mean is taken, so that a comment may change; of others (setpoints,
    baselines, calibrations) their content.
    """
    files = {
        path: digest
        for path, digest in campaign.source_files.items()
        if Path(path).suffix not in _YAML
    }
    meant = {
        "name": campaign.name,
        "tests": plain(campaign.tests),
        "filter": campaign.filter_name,
        "false_alarms_per_day": campaign.false_alarms_per_day,
        "conditions": plain(campaign.conditions),
        "files": sorted(files.values()),
    }
    return {
        "campaign": _sha256(meant),
        "rig": _sha256(plain(rig)),
        "model": model_sha256(campaign.model),
    }


def changed(kept: Mapping[str, Any], found: Mapping[str, str]) -> list[str]:
    """Return what is not the same any more, by name."""
    return [part for part, digest in found.items() if kept.get(part) != digest]


def _sha256(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
