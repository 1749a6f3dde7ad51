"""Kinds of vectors, quantities of gas sensors and physical constants that all packages share."""

Vec3 = tuple[float, float, float]
"""Three numbers along x, y and z; frame and unit are part of the variable's name."""

BEAM_QUANTITY = "path_integrated_mixing_ratio"
"""Quantity of gas sensors that measure along a beam; all others measure at a point."""

GAS_QUANTITIES = {
    "resistance": "ohm", "mixing_ratio": "ppm", "gas_detected": "1", "hits": "1", BEAM_QUANTITY: "ppm m",
}  # fmt: skip
"""Unit of each quantity of gas sensors."""

POINT_GAS_QUANTITIES = tuple(quantity for quantity in GAS_QUANTITIES if quantity != BEAM_QUANTITY)
"""Quantities of gas sensors that measure at a point."""

ESTIMATE_QUANTITY = "estimated_mixing_ratio"
"""Mixing ratio [ppm] that a MOX sensor's data sheet gives for its resistance; no sensor's own quantity."""

GRAVITY_M_S2 = 9.81
"""Acceleration of free fall [m/s2]."""

PHYSICS_STEP_MS = 4
"""Step of the physics [ms], 250 Hz: a tick is a whole number of them."""
