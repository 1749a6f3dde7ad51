# pyright: reportAttributeAccessIssue=false
"""Description of a vehicle in URDF, made of its MJCF and its drawing, for the tools of ROS."""

import math
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.vehicles.catalogue import RotorDrawing, Vehicle, WheelDrawing

_DARK, _LIGHT = "0.15 0.15 0.18 1", "0.55 0.6 0.65 0.8"
# Discs of rotors are as thick as a tenth of their radius.
_DISC_SHARE = 0.1
_AXLE_RPY = (math.pi / 2, 0.0, 0.0)
_Shape = tuple[str, dict[str, str]]


def build_urdf(vehicle: Vehicle, link: str) -> str:
    """Return a vehicle as one rigid link, whose frame is the body frame: rotors and wheels stand still in it.

    Mass, inertia and the shapes that touch are those of the MJCF, what is seen is the drawing of recordings; shapes
    that URDF does not have are left out.

    Args:
        vehicle: From the catalogue.
        link: Name of the link, such as `beetle/base_link`.
    """
    robot = ElementTree.Element("robot", name=vehicle.name)
    body = ElementTree.SubElement(robot, "link", name=link)
    model = mujoco.MjModel.from_xml_path(str(vehicle.mjcf_path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # The free joint of the body stands at the origin in its reference pose.
    _add_inertia(body, model, data)
    _add_visuals(body, vehicle)
    for i in range(model.ngeom):
        shape = _describe_geom(int(model.geom_type[i]), model.geom_size[i])
        if shape is not None:
            rpy_rad = rpy_from_rotation(data.geom_xmat[i].reshape(3, 3))
            _add_shape(body, "collision", shape, data.geom_xpos[i], rpy_rad)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _add_inertia(link: ElementTree.Element, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    masses_kg = np.asarray(model.body_mass)
    mass_kg = float(masses_kg.sum())
    centre_m = masses_kg @ np.asarray(data.xipos) / mass_kg
    inertia_kg_m2 = np.zeros((3, 3))
    for i, part_kg in enumerate(masses_kg):
        axes, arm_m = data.ximat[i].reshape(3, 3), data.xipos[i] - centre_m
        # About the common centre of mass, by the theorem of parallel axes.
        inertia_kg_m2 += axes @ np.diag(model.body_inertia[i]) @ axes.T
        inertia_kg_m2 += part_kg * (arm_m @ arm_m * np.eye(3) - np.outer(arm_m, arm_m))
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=_format(centre_m))
    ElementTree.SubElement(inertial, "mass", value=_format([mass_kg]))
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ElementTree.SubElement(
        inertial, "inertia", {name: _format([inertia_kg_m2[place]]) for name, place in names.items()}
    )


def _add_visuals(link: ElementTree.Element, vehicle: Vehicle) -> None:
    rotors, wheels, drawing = vehicle.rotors, vehicle.wheels, vehicle.drawing
    if rotors is not None and isinstance(drawing, RotorDrawing):
        scale, radius_m = drawing.scale, drawing.scale * rotors.rotor_radius_m
        _add_shape(link, "visual", _describe_box(scale * np.array(drawing.hull_half_m)), np.zeros(3), colour=_DARK)
        for place_m in rotors.rotor_places_m:
            disc = _describe_cylinder(radius_m, _DISC_SHARE * radius_m)
            _add_shape(link, "visual", disc, scale * np.array(place_m), colour=_LIGHT)
    elif wheels is not None and isinstance(drawing, WheelDrawing):
        for centre_m, half_m in (
            (drawing.chassis_centre_m, drawing.chassis_half_m),
            (drawing.plate_centre_m, drawing.plate_half_m),
        ):
            _add_shape(link, "visual", _describe_box(np.array(half_m)), np.array(centre_m), colour=_LIGHT)
        for side in (1.0, -1.0):
            wheel = _describe_cylinder(wheels.wheel_radius_m, drawing.wheel_width_m)
            place_m = np.array([0.0, side * wheels.half_track_m, wheels.axle_height_m])
            _add_shape(link, "visual", wheel, place_m, _AXLE_RPY, colour=_DARK)
        caster = ("sphere", {"radius": _format([wheels.caster_radius_m])})
        _add_shape(link, "visual", caster, np.array(wheels.caster_place_m), colour=_DARK)
    else:
        ball = ("sphere", {"radius": _format([vehicle.body.radius_m])})
        _add_shape(link, "visual", ball, np.zeros(3), colour=_LIGHT)


def _describe_box(half_m: NDArray[np.float64]) -> _Shape:
    return "box", {"size": _format(2 * half_m)}


def _describe_cylinder(radius_m: float, length_m: float) -> _Shape:
    return "cylinder", {"radius": _format([radius_m]), "length": _format([length_m])}


def _describe_geom(kind: int, size_m: NDArray[np.float64]) -> _Shape | None:
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _describe_box(size_m)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _describe_cylinder(size_m[0], 2 * size_m[1])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return "sphere", {"radius": _format(size_m[:1])}
    return None


def _add_shape(
    link: ElementTree.Element,
    purpose: str,
    shape: _Shape,
    place_m: NDArray[np.float64],
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    colour: str | None = None,
) -> None:
    element = ElementTree.SubElement(link, purpose)
    ElementTree.SubElement(element, "origin", xyz=_format(place_m), rpy=_format(rpy_rad))
    ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), *shape)
    if colour is not None:
        # Materials of one name are one material in URDF.
        material = ElementTree.SubElement(element, "material", name="dark" if colour == _DARK else "light")
        ElementTree.SubElement(material, "color", rgba=colour)


def _format(values: "NDArray[np.float64] | list[float] | tuple[float, ...]") -> str:
    return " ".join(f"{value:.9g}" for value in values)


def rpy_from_rotation(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a (3, 3) rotation matrix, the inverse of `rotation_from_rpy`.

    The pitch is from -pi/2 to pi/2.
    """
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        math.asin(min(1.0, max(-1.0, -rotation[2, 0]))),
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )
