"""Kinds of vectors, quantities of gas sensors and physical constants that all packages share."""

Vec3 = tuple[float, float, float]
"""Three numbers along x, y and z; frame and unit are in the name of what holds them."""

POINT_GAS_QUANTITIES = ("resistance", "mixing_ratio", "gas_detected", "hits")
"""What sensors of the gas at a place report."""

GAS_QUANTITIES = (*POINT_GAS_QUANTITIES, "path_integrated_mixing_ratio")
"""What gas sensors report; the last along a beam."""

GRAVITY_M_S2 = 9.81
"""Acceleration of free fall [m/s2]."""

PHYSICS_STEP_MS = 4
"""Step of the physics [ms], 250 Hz: a tick is a whole number of them."""
