"""The cases of the comparison: recordings to fit to, recordings held out, and what is hidden."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import yaml

from estimator.gap.servo.effects import EFFECTS
from tools.hidden_effects.drawn_trials import write_recordings
from tools.hidden_effects.trials import Plan as TrialPlan, drawn_for
from tools.peers.oscillators import PLANT, written

SHARED: Final[dict[str, tuple[str, ...]]] = {
    "case_1": ("spool_null_bias",),
    "case_2": ("friction_asymmetry",),
    "case_3": ("valve_deadband",),
    "case_4": ("command_delay",),
    "case_5": ("pressure_1_bias",),
    "case_6": ("internal_leakage", "return_back_pressure"),
    "case_7": (),
}
"""What is hidden in each of the shared cases (their `answers.json`, in the catalogue's names)."""

_BOTH: Final = {"flows of both chambers": ("flow, chamber 1", "flow, chamber 2")}


@dataclass(frozen=True)
class Plan:
    """One case before its recordings are made or found.

    Attributes:
        group: "shared", "hidden", "oscillators" or "listed".
        name: of the case, unique in its group.
        made_of: what `case_of` makes the case of, as plain values.
    """

    group: str
    name: str
    made_of: dict[str, Any]

    @property
    def key(self) -> str:
        """A text that differs between any two plans."""
        return f"{self.group} {self.name} {sorted(self.made_of.items())}"


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        fit: recordings to fit to.
        holdout: recordings held out.
        model: name or file of the model given.
        plant: `--plant` of `rig gap`; empty for the rig.
        hidden: what is hidden, in words.
        names: effects of the catalogue that are hidden.
        verdict: verdict that is right where no effect of the catalogue is hidden; "" if unknown.
        equations: equations or readings that are disturbed, one of them most; empty if unknown.
        of: quantities that the hidden disturbance depends on; empty if unknown.
    """

    fit: tuple[Path, ...]
    holdout: tuple[Path, ...]
    model: str = "nominal"
    plant: str = ""
    hidden: str = ""
    names: tuple[str, ...] = ()
    verdict: str = ""
    equations: tuple[str, ...] = ()
    of: tuple[str, ...] = field(default=())


def shared_plans(folder: Path, names: Sequence[str] | None = None) -> list[Plan]:
    """Return the plans of the shared cases in a folder; those that it lacks are left out."""
    found = [name for name in names or SHARED if (folder / name).is_dir()]
    return [Plan("shared", name, {"folder": str(folder / name)}) for name in found]


def hidden_plans(kind: str, trials: int, seed: int, seconds: float, limits: float) -> list[Plan]:
    """Return the plans of trials of one kind of `tools.hidden_effects` (`drawn_trial`)."""
    return [
        Plan(
            "hidden", f"{kind} {number}",
            {"kind": kind, "seed": seed, "number": number, "seconds": seconds, "times": limits},
        )
        for number in range(trials)
    ]  # fmt: skip


def oscillator_plans(count: int, seed: int) -> list[Plan]:
    """Return the plans of a number of oscillators (`oscillators.drawn`)."""
    return [Plan("oscillators", str(n), {"seed": seed, "number": n}) for n in range(count)]


def listed_plans(file: Path) -> list[Plan]:
    """Return the plans that a YAML file lists, such as measured machines.

    The file holds a list of mappings with `name`, `fit` and `holdout` (lists of recordings), and if
    need be `model`, `plant`, `hidden`, `names`, `verdict`, `equations` and `of`, as in
    `Case`. Paths of recordings, models and plants are relative to the file.

    Raises:
        ValueError: an entry lacks a name or recordings, or has another key.
    """
    found = []
    for entry in yaml.safe_load(file.read_text(encoding="utf-8")):
        more = set(entry) - {"name", *Case.__dataclass_fields__}
        if more or not {"name", "fit", "holdout"} <= set(entry):
            raise ValueError(
                f"{file}: {entry.get('name')}: give name, fit and holdout"
                + (f"; {', '.join(sorted(more))} is not known" if more else "")
            )
        found.append(Plan("listed", entry["name"], {"file": str(file), **entry}))
    return found


def case_of(plan: Plan, folder: Path) -> Case:
    """Return the case of a plan; recordings that are made are written to `folder`."""
    if plan.group == "shared":
        return _shared(Path(plan.made_of["folder"]))
    if plan.group == "hidden":
        return _hidden(TrialPlan(**plan.made_of), folder)
    if plan.group == "oscillators":
        return _oscillator(plan.made_of["seed"], plan.made_of["number"], folder)
    return _listed(plan.made_of)


def _shared(folder: Path) -> Case:
    names = SHARED.get(folder.name, ())
    fit = tuple(sorted(folder.glob("identify_*.csv.gz")))
    return Case(
        fit, (folder / "holdout.csv.gz",), hidden=_told(names), names=names,
        verdict="" if names else "adequate", equations=_entered(names),
    )  # fmt: skip


def _hidden(trial: TrialPlan, folder: Path) -> Case:
    drawn = drawn_for(trial, folder / "shown")
    files = write_recordings(drawn, folder / "recordings")
    held = files.pop("holdout")
    names = tuple(drawn.envelope.effects)
    verdict = {"off_menu": "unknown_effect", "none": "adequate"}.get(trial.kind, "")
    return Case(
        tuple(files.values()), (held,), hidden=_told((*names, *drawn.envelope.off_menu)),
        names=names, verdict=verdict, equations=_entered(names),
    )  # fmt: skip


def _oscillator(seed: int, number: int, folder: Path) -> Case:
    hidden, files, model = written(seed, number, folder)
    held = files.pop("holdout")
    return Case(
        tuple(files.values()), (held,), str(model), PLANT, hidden.text,
        verdict="unknown_effect", equations=("force balance",), of=hidden.of,
    )  # fmt: skip


def _listed(entry: dict[str, Any]) -> Case:
    base = Path(entry["file"]).parent
    fields = {key: value for key, value in entry.items() if key not in ("file", "name")}
    for key in ("fit", "holdout"):
        fields[key] = tuple(base / each for each in fields[key])
    for key in ("names", "equations", "of"):
        fields[key] = tuple(fields.get(key, ()))
    model = fields.get("model", "nominal")
    fields["model"] = str(base / model) if (base / model).is_file() else model
    source, _, thing = fields.get("plant", "").rpartition(":")
    if source and (base / source).is_file():
        fields["plant"] = f"{base / source}:{thing}"
    return Case(**fields)


def _told(names: Sequence[str]) -> str:
    return " and ".join(name.replace("_", " ") for name in names) or "nothing"


def _entered(names: Sequence[str]) -> tuple[str, ...]:
    """Return the equations, or channels, that effects of the catalogue enter."""
    places = [EFFECTS[name].where for name in names if name in EFFECTS]
    return tuple(dict.fromkeys(each for place in places for each in _BOTH.get(place, (place,))))
