"""Kinds of vectors and physical constants that all packages share."""

Vec3 = tuple[float, float, float]
"""Three numbers along x, y and z; frame and unit are in the name of what holds them."""

GRAVITY_M_S2 = 9.81
"""Acceleration of free fall [m/s2]."""

PHYSICS_STEP_MS = 4
"""Step of the physics [ms], 250 Hz: a tick is a whole number of them."""
