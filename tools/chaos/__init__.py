"""The chaos suite: makes a part of a running emulated rig fail and checks what follows.

What the devices did is read from the record that the emulator writes.
"""
