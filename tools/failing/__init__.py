"""Lets each place of the product that asks the system for something fail once, and judges the run.

The places are call sites of open, write, fsync, rename, mmap, socket, thread start and the like, as
a small campaign reaches them, on the simulated rig and on the emulated one.
"""
