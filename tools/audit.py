"""Audits what the product runs with: known vulnerabilities, licences, and the bill of materials.

`make audit` runs it in an environment of its own, with pip-audit and cyclonedx-bom. What it judges
is what `requirements-lock.txt` pins, as it is installed in `.venv`. The exit code is 0 if all is
well, 1 if a vulnerability or a licence is to be looked at, and 3 if something could not be audited,
which is no good news either.
"""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
LOCK: Final = ROOT / "requirements-lock.txt"
MATERIALS: Final = ROOT / "dist" / "bom.cdx.json"
PATIENCE_S: Final = 900.0
"""Time in s after which an audit that does not end is given up. Reading what is installed takes
12 s of computing, and two minutes on a machine that does other work."""

ALLOWED: Final = {
    "0BSD", "APACHE SOFTWARE LICENSE", "APACHE-2.0", "APACHE-2.0 WITH LLVM-EXCEPTION",
    "BSD LICENSE", "BSD-2-CLAUSE", "BSD-3-CLAUSE", "CC0-1.0", "EPL-1.0", "EPL-2.0", "ISC",
    "LGPL-3.0-ONLY", "LGPL-3.0-OR-LATER", "MIT", "MIT LICENSE", "MIT-CMU", "MPL-2.0",
    "MOZILLA PUBLIC LICENSE 2.0 (MPL 2.0)", "PSF-2.0", "PYTHON-2.0", "ZLIB",
}  # fmt: skip
"""Licences, in capitals, under which a program with Apache-2.0 may use a library that it does not
change: permissive ones, and those whose copyleft ends at the library (EPL, LGPL, MPL)."""

FINE, FOUND, NOT_AUDITED = 0, 1, 3


def canonical(name: str) -> str:
    """Return a package's name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned(lock: str) -> dict[str, str]:
    """Return package -> version of what a lock pins, from its text."""
    found = re.findall(r"^([A-Za-z0-9._-]+)(?:\[[^]]*\])?==([^\s;\\]+)", lock, re.MULTILINE)
    return {canonical(name): version for name, version in found}


def vulnerabilities(report: Mapping[str, Any], wanted: Iterable[str]) -> tuple[int, list[str]]:
    """Return the exit code and the lines on what pip-audit reported, as JSON.

    A package that was not looked up is not taken for a sound one.

    Args:
        report: what pip-audit wrote.
        wanted: names of the packages that it was to audit.
    """
    known = {canonical(each["name"]): each for each in report["dependencies"]}
    # A pin for another system or Python is not installed here, and pip-audit leaves it out.
    skipped = sorted(name for name, each in known.items() if "skip_reason" in each)
    lines = [
        f"{name} {each['version']}: {flaw['id']}, fixed in "
        f"{', '.join(flaw['fix_versions']) or 'no version yet'}"
        for name, each in known.items()
        for flaw in each.get("vulns", ())
    ]
    code = FOUND if lines else FINE
    audited = [name for name in wanted if name in known and name not in skipped]
    if skipped or not audited:
        lines.append(
            f"not audited: {len(skipped)} of {len(known)} packages were not found by the service "
            f"({', '.join(skipped[:5])}{', ...' if len(skipped) > 5 else ''}); is it reached from "
            "here? Try again where https://pypi.org/pypi/NAME/json can be read"
        )
        code = code or NOT_AUDITED
    return code, lines or [f"no known vulnerability in {len(audited)} packages"]


def licences_of(component: Mapping[str, Any]) -> list[str]:
    """Return the licences that a component of a CycloneDX bill names, shortest form first."""
    found = []
    for entry in component.get("licenses", ()):
        one = entry.get("license", {})
        text = entry.get("expression") or one.get("id") or one.get("name") or ""
        found.append(text.rpartition(" :: ")[2])
    return [text for text in found if text]


def is_allowed(expression: str) -> bool:
    """Return whether a licence may be used: one part of an `OR` is enough, of an `AND` all count.

    Brackets are not looked at: `A AND (B OR C)` is read as it is meant, and others are refused.
    """
    if expression.strip().upper() in ALLOWED:
        return True
    bare = re.sub(r"[()]", "", expression).upper()
    parts = re.split(r"\s+AND\s+", bare)
    return all(any(each.strip() in ALLOWED for each in part.split(" OR ")) for part in parts)


def licences(components: Iterable[Mapping[str, Any]]) -> tuple[int, list[str]]:
    """Return the exit code and the lines on licences that are not in `ALLOWED`, or not named."""
    lines, count = [], 0
    for component in components:
        count += 1
        named = licences_of(component)
        refused = [each for each in named if not is_allowed(each)]
        if not named or refused:
            told = ", ".join(refused) or "none named"
            lines.append(
                f"{component['name']} {component.get('version', '')}: licence {told}; look at it, "
                "and add it to ALLOWED in tools/audit.py or do without the package"
            )
    return (FOUND, lines) if lines else (FINE, [f"licences of {count} packages are allowed"])


def materials(bill: Mapping[str, Any], wanted: Mapping[str, str]) -> dict[str, Any]:
    """Return a CycloneDX bill with the packages that are pinned, and what depends on which."""
    kept = [each for each in bill["components"] if canonical(each["name"]) in wanted]
    references = {each["bom-ref"] for each in kept}
    dependencies = [
        {**each, "dependsOn": [ref for ref in each.get("dependsOn", ()) if ref in references]}
        for each in bill.get("dependencies", ())
        if each["ref"] in references
    ]
    return {**bill, "components": kept, "dependencies": dependencies}


def _told(command: list[str]) -> dict[str, Any]:
    """Return the JSON that a command writes.

    Raises:
        RuntimeError: it writes none, or does not end.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        content: dict[str, Any] = json.loads(done.stdout)
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        said = done.stderr.strip().splitlines() if isinstance(error, ValueError) else [str(error)]
        raise RuntimeError(said[-1] if said else "it said nothing") from None
    return content


def main() -> int:
    """Audit, write the bill of materials, print what was found; return the worst exit code."""
    argparse.ArgumentParser(prog="python -m tools.audit", description=__doc__).parse_args()
    wanted = pinned(LOCK.read_text(encoding="utf-8"))
    bin_folder = Path(sys.executable).parent
    code = FINE

    def tell(what: str, found: tuple[int, list[str]]) -> None:
        nonlocal code
        # What was found goes before what was not audited.
        code = found[0] if code in (FINE, NOT_AUDITED) and found[0] != FINE else code
        print(f"{what}:", *(f"  {line}" for line in found[1]), sep="\n", flush=True)

    audit = [str(bin_folder / "pip-audit"), "--requirement", str(LOCK), "--disable-pip"]
    options = ["--require-hashes", "--progress-spinner", "off", "--format", "json"]
    try:
        tell("vulnerabilities", vulnerabilities(_told([*audit, *options]), wanted))
    except RuntimeError as error:
        tell("vulnerabilities", (NOT_AUDITED, [f"not audited: pip-audit failed: {error}"]))
    python = str(ROOT / ".venv" / "bin" / "python")
    listing = [str(bin_folder / "cyclonedx-py"), "environment", "--of", "JSON", python]
    try:
        bill = materials(_told(listing), wanted)
    except RuntimeError as error:
        tell("licences", (NOT_AUDITED, [f"not audited: cyclonedx-py failed: {error}"]))
        return code
    tell("licences", licences(bill["components"]))
    MATERIALS.parent.mkdir(exist_ok=True)
    MATERIALS.write_text(json.dumps(bill, indent=1) + "\n", encoding="utf-8")
    where = MATERIALS.relative_to(ROOT)
    tell("bill of materials", (FINE, [f"{where}: {len(bill['components'])} packages, CycloneDX"]))
    return code


if __name__ == "__main__":
    sys.exit(main())
