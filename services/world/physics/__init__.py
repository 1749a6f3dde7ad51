"""Physics: the MuJoCo scene and the compiled loop of control, rotors, wheels and contacts."""
