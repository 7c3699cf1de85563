"""The chaos suite: what follows when a part of a running rig fails, by the emulator's record."""
