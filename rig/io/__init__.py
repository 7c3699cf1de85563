"""One protocol to the hardware (read, write, safe_state) and the drivers that serve it.

Addresses come from configuration; optional imports stay inside the driver that needs them.
"""
