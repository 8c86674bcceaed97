"""Engine: the physics and the control step, compiled when the package is built."""
