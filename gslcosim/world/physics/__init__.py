"""MuJoCo and the compiled loop: the scene, control, rotors, wheels."""
