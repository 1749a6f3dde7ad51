"""The MJCF body of a vehicle, and whether it is what the catalogue says."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Iterator
from functools import cache
from typing import Any

import mujoco

from gslcosim.errors import VehicleError
from gslcosim.vehicles import Vehicle

# Masses, lengths and places of MJCF and catalogue are equal but for rounding; a radius may be a round number.
_EQUAL = 1e-6
_ROUND = 0.05


def body_spec(vehicle: Vehicle) -> mujoco.MjSpec:
    """Return a fresh MJCF specification with the one body of a vehicle, named `body`.

    Raises:
        VehicleError: the MJCF cannot be compiled, or contradicts the catalogue.
    """
    check_body(vehicle)
    return mujoco.MjSpec.from_file(str(vehicle.mjcf_path))


# Once in a process: a suite flies the same vehicle thousands of times.
@cache
def check_body(vehicle: Vehicle) -> None:
    """Compile the MJCF of a vehicle by itself and compare it with the catalogue.

    Raises:
        VehicleError: it cannot be compiled, a part is missing, or it differs in mass, reach, height, rotors or wheels;
            all of it in one text.
    """
    try:
        model = mujoco.MjSpec.from_file(str(vehicle.mjcf_path)).compile()
    except ValueError as error:
        raise VehicleError(
            f"vehicle {vehicle.name}: expected an MJCF that MuJoCo compiles, got: {error}\nFile: {vehicle.mjcf_path}"
        ) from error
    problems = [*_missing_parts(vehicle, model)] or [*_differences(vehicle, model)]
    if problems:
        lines = [f"vehicle {vehicle.name}: {problem}" for problem in problems]
        raise VehicleError("\n".join([*lines, f"File: {vehicle.mjcf_path}"]))


def half_height_m(model: mujoco.MjModel, root: int) -> float:
    """Return how far the lowest point of a vehicle is below its centre [m].

    Parts of a vehicle are not turned against its body at the start; each hangs on the body itself.

    Args:
        model: A compiled model.
        root: Index of the vehicle's body in it.
    """
    return max(_depth_m(model, i, root) for i in range(model.ngeom) if _root_of(model, i) == root)


# geom_aabb is centre and half size in the geom's frame.
def _depth_m(model: mujoco.MjModel, geom: int, root: int) -> float:
    body = int(model.geom_bodyid[geom])
    height_m = float(model.geom_pos[geom][2] + model.geom_aabb[geom][2])
    if body != root:
        height_m += float(model.body_pos[body][2])
    return float(model.geom_aabb[geom][5]) - height_m


def _root_of(model: mujoco.MjModel, geom: int) -> int:
    return int(model.body_rootid[model.geom_bodyid[geom]])


def _missing_parts(vehicle: Vehicle, model: mujoco.MjModel) -> Iterator[str]:
    parts = {"body": ["body"], "joint": ["free"], "geom": ["hull"]}
    if vehicle.rotors is not None:
        parts["site"] = [f"rotor_{i}" for i in range(vehicle.rotors.n_rotors)]
    if vehicle.wheels is not None:
        wheels = ["wheel_left", "wheel_right"]
        parts["body"] += [*wheels, "caster"]
        parts["joint"] += wheels
        parts["geom"] += [*wheels, "caster"]
        parts["site"] = ["hull"]
    for kind, names in parts.items():
        number = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        for name in names:
            if mujoco.mj_name2id(model, number, name) < 0:
                yield f"expected a {kind} named {name}, found none."


def _differences(vehicle: Vehicle, model: mujoco.MjModel) -> Iterator[str]:
    body, root = vehicle.body, model.body("body").id
    across_m = _reach_of_geoms_m(model, root)
    reach_m = vehicle.rotors.reach_m if vehicle.rotors else across_m
    yield from _unlike("body.mass_kg", body.mass_kg, model.body_subtreemass[root])
    yield from _unlike("body.half_height_m", body.half_height_m, half_height_m(model, root))
    yield from _unlike("body.radius_m", body.radius_m, reach_m, within=_ROUND)
    if across_m > body.radius_m * (1.0 + _ROUND):
        yield from _unlike("body.radius_m", body.radius_m, across_m)
    if vehicle.rotors is not None:
        for i, place_m in enumerate(vehicle.rotors.rotor_places_m):
            yield from _unlike_places(f"rotors.rotor_places_m[{i}]", place_m, model.site(f"rotor_{i}").pos)
    if vehicle.wheels is not None:
        yield from _differences_of_wheels(vehicle, model)


def _differences_of_wheels(vehicle: Vehicle, model: mujoco.MjModel) -> Iterator[str]:
    wheels = vehicle.wheels
    assert wheels is not None
    for side, name in ((1.0, "wheel_left"), (-1.0, "wheel_right")):
        what = f"the place of {name}, from half_track_m and axle_height_m"
        place_m = (0.0, side * wheels.half_track_m, wheels.axle_height_m)
        yield from _unlike_places(what, place_m, model.body(name).pos)
        yield from _unlike("wheels.wheel_radius_m", wheels.wheel_radius_m, model.geom(name).size[0])
    yield from _unlike_places("wheels.caster_place_m", wheels.caster_place_m, model.body("caster").pos)
    yield from _unlike("wheels.caster_radius_m", wheels.caster_radius_m, model.geom("caster").size[0])


# The farthest that the boxes around the geoms reach along the body's x and y axes, [m].
def _reach_of_geoms_m(model: mujoco.MjModel, root: int) -> float:
    reaches_m = [
        abs(float(model.geom_pos[i][axis] + model.geom_aabb[i][axis])) + float(model.geom_aabb[i][3 + axis])
        for i in range(model.ngeom)
        if model.geom_bodyid[i] == root
        for axis in range(2)
    ]
    return max(reaches_m)


def _unlike(what: str, told: float, compiled: float, *, within: float = _EQUAL) -> Iterator[str]:
    if not math.isclose(told, float(compiled), rel_tol=within):
        yield f"{what}: expected {float(compiled):g}, as the MJCF has it, was {told:g}."


def _unlike_places(what: str, told: tuple[float, float, float], compiled: Any) -> Iterator[str]:
    if any(abs(a - float(b)) > _EQUAL for a, b in zip(told, compiled, strict=True)):
        shown = ", ".join(f"{float(b):g}" for b in compiled)
        yield f"{what}: expected [{shown}], as the MJCF has it, was [{', '.join(f'{a:g}' for a in told)}]."
