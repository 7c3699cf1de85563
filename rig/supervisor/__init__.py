"""Runs a hardware session: its processes, its state machine, and every way out of it."""
