"""A console or a browser is killed at any moment beside a station, and nobody is told a wrong word.

Neither is part of what drives the rig: what they watch goes on, and what they move by hand rests.
"""

import random
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Error, Page, expect, sync_playwright

from tests.rig.console.conftest import LONGEST
from tools.chaos.lab import JOG, STREAMED, Lab, lab_in
from tools.chaos.stage import COMPILE_S, PATIENCE_S, _free_ports
from tools.pages.readme_picture import browser as chromium

pytestmark = pytest.mark.long

KILLS = 20
WAIT_MS = 60_000
WAVE = "generator sine mean 300mm amplitude 20mm frequency 0.2Hz"
WAY_M = 5e-3
"""Way in m within which the ram rests after the last heartbeat (docs/safety.md)."""
REST_S = 0.25
"""Time in s within which it does."""
SPEED_M_PER_S = 20e-3
"""Speed of hold-to-run, m/s."""
CREEP_M = 0.5e-3
"""What the ram may creep at rest, and what reading its position by the control port adds, m."""
