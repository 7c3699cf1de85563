"""Commands about the rig itself: home, calibrate, doctor, and the emulated rig."""
