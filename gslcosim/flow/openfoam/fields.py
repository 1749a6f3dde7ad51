"""The fields of an OpenFOAM case at its start, and what holds for them on each boundary."""

from collections.abc import Iterable, Mapping
from typing import Any

from gslcosim.flow.openfoam.polymesh import Boundary
from gslcosim.flow.pressure import F32
from gslcosim.flow.pressure_kernels import LOW
from gslcosim.flow.turbulence import inlet_turbulence, start_turbulence
from gslcosim.flow.walls.domain import Domain, PlacedPatch
from gslcosim.flow.walls.patches import Inlet, MovingWall, Outlet, SlipWall

Condition = Mapping[str, Any]
Level = Mapping[str, float]  # k and epsilon

_ZERO_GRADIENT = {"type": "zeroGradient"}
_CALCULATED = {"type": "calculated", "value": "uniform 0"}
_SLIP = {"type": "slip"}

_DIMENSIONS = {
    "U": "[0 1 -1 0 0 0 0]",
    "p": "[0 2 -2 0 0 0 0]",
    "k": "[0 2 -2 0 0 0 0]",
    "epsilon": "[0 2 -3 0 0 0 0]",
    "nut": "[0 2 -1 0 0 0 0]",
}
_FIELDS = {"k_epsilon": ("U", "p", "k", "epsilon", "nut"), "smagorinsky": ("U", "p", "nut"), "laminar": ("U", "p")}


def fields_of(domain: Domain, boundaries: tuple[Boundary, ...], turbulence: str) -> dict[str, dict[str, Any]]:
    """Return the start of each field that a turbulence model needs, by OpenFOAM's name.

    Air is still; k and epsilon are those that the built-in solver starts with, everywhere.
    """
    start = _level(*start_turbulence(domain))
    return {
        name: {
            "dimensions": _DIMENSIONS[name],
            "internalField": "uniform (0 0 0)" if name == "U" else f"uniform {start.get(name, 0.0)!r}",
            "boundaryField": {b.name: _condition(name, b, domain, start, turbulence) for b in boundaries},
        }
        for name in _FIELDS[turbulence]
    }


def _condition(field: str, boundary: Boundary, domain: Domain, start: Level, turbulence: str) -> Condition:
    if boundary.placed is None:
        return _at_wall(field, (0.0, 0.0, 0.0), start, turbulence)
    patch = boundary.placed.patch
    if isinstance(patch, MovingWall):
        return _at_wall(field, patch.velocity_m_s, start, turbulence)
    if isinstance(patch, SlipWall):
        return _CALCULATED if field == "nut" else _SLIP
    if isinstance(patch, Outlet):
        return _at_outlet(field, start)
    assert isinstance(patch, Inlet), "write_case refuses other kinds"
    level = _level(*inlet_turbulence(boundary.placed, domain))
    return _at_inlet(field, _inlet_velocities(boundary.placed, domain), level)


def _at_wall(field: str, velocity_m_s: tuple[float, float, float], start: Level, turbulence: str) -> Condition:
    if field == "U":
        return _fixed(velocity_m_s)
    if field == "p":
        return _ZERO_GRADIENT
    if field == "nut":
        # Without a turbulence energy the wall's friction follows from the speed beside it alone.
        function = "nutkWallFunction" if turbulence == "k_epsilon" else "nutUSpaldingWallFunction"
        return {"type": function, "value": "uniform 0"}
    function = {"k": "kqRWallFunction", "epsilon": "epsilonWallFunction"}[field]
    return {"type": function, "value": f"uniform {start[field]!r}"}


def _at_outlet(field: str, start: Level) -> Condition:
    if field == "p":
        return {"type": "fixedValue", "value": "uniform 0"}
    if field == "U":
        return {"type": "pressureInletOutletVelocity", "value": "uniform (0 0 0)"}
    if field == "nut":
        return _CALCULATED
    inside = f"uniform {start[field]!r}"
    return {"type": "inletOutlet", "inletValue": inside, "value": inside}


def _at_inlet(field: str, velocities_m_s: F32, level: Level) -> Condition:
    if field == "U":
        first = velocities_m_s[0]
        return _fixed(first) if (velocities_m_s == first).all() else _fixed_each(velocities_m_s)
    if field == "p":
        return _ZERO_GRADIENT
    if field == "nut":
        return _CALCULATED
    return {"type": "fixedValue", "value": f"uniform {level[field]!r}"}


def _level(k_m2_s2: float, epsilon_m2_s3: float) -> Level:
    return {"k": float(k_m2_s2), "epsilon": float(epsilon_m2_s3)}


# (n, 3) velocities of the inlet's faces, in the order of the mesh: that of their cells.
def _inlet_velocities(placed: PlacedPatch, domain: Domain) -> F32:
    assert placed.inflow is not None, "inlets have one"
    inside = LOW + domain.shape[placed.axis] - 1 if placed.is_high else LOW
    return placed.inflow.profile_m_s[domain.air[placed.layer(inside)]]


def _fixed(velocity_m_s: Iterable[float]) -> Condition:
    return {"type": "fixedValue", "value": f"uniform {_vector(velocity_m_s)}"}


def _fixed_each(velocities_m_s: F32) -> Condition:
    vectors = " ".join(_vector(velocity) for velocity in velocities_m_s)
    return {"type": "fixedValue", "value": f"nonuniform List<vector> {len(velocities_m_s)}({vectors})"}


def _vector(components: Iterable[float]) -> str:
    return f"({' '.join(f'{component:.9g}' for component in components)})"
