"""The rig's hardware as a program of its own: the plant in real time behind the real protocols."""
