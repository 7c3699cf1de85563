"""A campaign runs under every Python that is promised, and for a user who may do little.

Each of these installs or compiles everything anew, and so takes minutes.
"""

import json
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PATIENCE_S = 1800
"""Time in s for one run: compiling takes a minute of computing, and the machine may be busy."""
RIG = "import sys; from rig.cli import main; main(sys.argv[1:])"
NOBODY = 65534
CAMPAIGN = """
name: short
rig: simulated
model: nominal
detector: {filter: product, false_alarms_per_day: 1}
defaults:
  duration: 20 s
  setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz, phase: 0.1 rad}
tests:
  - name: leak
    faults: [{type: external_leakage_1, at: 10 s, flow: 0.8 L/min, pressure: 6.9 MPa}]
"""

pytestmark = pytest.mark.long


def interpreter(version: str) -> str:
    """Return an interpreter of a version, such as "3.12"; skip the test where there is none."""
    if version == f"{sys.version_info.major}.{sys.version_info.minor}":
        return sys.executable
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    for found in (*sorted(pyenv.glob(f"{version}.*/bin/python")), shutil.which(f"python{version}")):
        if found and Path(found).exists():
            return str(found)
    pytest.skip(f"Python {version} is not on this machine")


def outcome(folder: Path) -> dict[str, object]:
    """Return what a run's results say of its only test."""
    (test,) = json.loads((folder / "results.json").read_text())["tests"]
    return {"status": test["status"], "verdict": test["found"]["verdict"]}


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_a_campaign_runs_under_each_python(version: str, tmp_path: Path) -> None:
    python = interpreter(version)
    if python != sys.executable:
        subprocess.run([python, "-m", "venv", tmp_path / "venv"], check=True)
        python = str(tmp_path / "venv" / "bin" / "python")
        install = ["-m", "pip", "install", "-q", "--only-binary", ":all:", "--require-hashes"]
        lock = str(ROOT / "requirements-lock.txt")
        if subprocess.run([python, *install, "-r", lock]).returncode:
            pytest.skip(f"the pins of requirements-lock.txt cannot be installed for {version} here")
    (tmp_path / "short.yaml").write_text(CAMPAIGN)
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "XDG_STATE_HOME": str(tmp_path / "state"),
    }  # fmt: skip
    run = [python, "-W", "error::DeprecationWarning:rig", "-c", RIG, "run", "short.yaml"]
    done = subprocess.run(
        [*run, "--out", "run"], cwd=tmp_path, env=environment, timeout=PATIENCE_S,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert outcome(tmp_path / "run") == {"status": "passed", "verdict": "external_leakage_1"}
    shown = subprocess.run(
        [python, "-c", RIG, "replay", "--json", "run/leak.mcap"], cwd=tmp_path, env=environment,
        timeout=PATIENCE_S, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert json.loads(shown.stdout)["verdict"] == "external_leakage_1"


def reachable_python(environment: Mapping[str, str], **user: object) -> str:
    """Return an interpreter of this version that another user may run; skip if there is none."""
    name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    for python in (sys.executable, f"/usr/bin/{name}", f"/usr/local/bin/{name}"):
        try:
            found = subprocess.run([python, "-c", "import numpy"], env=environment, **user)  # type: ignore[call-overload]
        except OSError:
            continue
        if found.returncode == 0:
            return python
    pytest.skip(f"no {name} that an ordinary user may run with the packages of this environment")


def test_a_user_without_rights_or_a_home_to_write_to_runs_a_campaign_that_only_he_can_read() -> (
    None
):
    if os.getuid() != 0:
        pytest.skip("only root can become another user")
    below = Path(subprocess.check_output(["mktemp", "-d"], text=True).strip())
    try:
        below.chmod(0o755)
        home, work = below / "home", below / "work"
        home.mkdir(mode=0o555)
        work.mkdir()
        os.chown(work, NOBODY, NOBODY)
        (below / "short.yaml").write_text(CAMPAIGN)
        (below / "short.yaml").chmod(0o644)
        packages = Path(np.__file__).parents[1]
        environment = {
            "PATH": "/usr/bin:/bin", "HOME": str(home), "TMPDIR": str(work), "LANG": "C.UTF-8",
            "PYTHONPATH": f"{ROOT}:{packages}", "PYTHONDONTWRITEBYTECODE": "1",
        }  # fmt: skip
        user: dict[str, object] = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
        python = reachable_python(environment, **user)

        def rig(*arguments: str) -> subprocess.CompletedProcess[str]:
            ran: subprocess.CompletedProcess[str] = subprocess.run(  # type: ignore[call-overload]
                [python, "-c", RIG, *arguments], cwd=work, env=environment, umask=0o077,
                timeout=PATIENCE_S, capture_output=True, text=True, **user,
            )  # fmt: skip
            return ran

        done = rig("run", "../short.yaml", "--out", "run")
        assert done.returncode == 0, done.stdout + done.stderr
        assert "raceback" not in done.stdout + done.stderr
        run = work / "run"
        assert outcome(run) == {"status": "passed", "verdict": "external_leakage_1"}
        shared = [path for path in (run, *run.iterdir()) if path.stat().st_mode & 0o077]
        assert shared == []
        assert {path.stat().st_uid for path in run.iterdir()} == {NOBODY}
        assert stat.S_IMODE((run / "report.html").stat().st_mode) == 0o600
        assert rig("runs", "show", "run", "--verify").returncode == 0
        assert list(home.iterdir()) == []
    finally:
        shutil.rmtree(below)
