"""The packages whose branches guide the search, by target.

They are told apart from the targets, as they must be instrumented before anything imports them.
None of them has compiled functions: those cannot be instrumented, and the compiler cannot read what
was.
"""

from typing import Final

_CONFIGURATION: Final = ("yaml", "rig.configuration")
_RECORDING: Final = ("mcap", "rig.recording")
_FOLDER: Final = ("rig.recording.bounds", "rig.runner.run_folder")
_STREAM: Final = ("rig.stream",)

GUIDES: Final[dict[str, tuple[str, ...]]] = {
    **dict.fromkeys(
        ("campaign", "rig", "model", "map", "stream_profile", "schedule", "sweep", "transducer"),
        _CONFIGURATION,
    ),
    "dbc": ("textparser", "cantools.database"),
    "mcap": _RECORDING,
    "csv": _RECORDING,
    "csv_gz": _RECORDING,
    "parquet": _RECORDING,
    "recover": _RECORDING,
    "results": _FOLDER,
    "journal": _FOLDER,
    "additions": ("rig.runner.schedule.additions",),
    "baseline": ("estimator.baselines.baseline_file", "estimator.baselines.checking"),
    "counters": ("rig.runner.counters.store",),
    "control": (
        "rig.control_socket", "rig.runner.campaign.operator_requests",
        "rig.runner.campaign.control_port",
    ),
    "message": _STREAM,
    "command": _STREAM,
    "modbus": ("rig.io.modbus_daq.plan",),
    "can": ("rig.io.can",),
    "meters": ("rig.io.flow_meters",),
    "http": ("rig.console",),
}  # fmt: skip
