"""Arms the injection in every Python process of a run that is tried, before anything else runs."""

from tools.failing.injection import arm_from_environment

arm_from_environment()
