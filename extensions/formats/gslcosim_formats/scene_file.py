"""Scene of a room as MJCF: the file `scene.xml` of an environment folder, for other programs."""

from collections.abc import Iterable
from xml.etree import ElementTree

from gslcosim.environment.model import Box, Environment

SCENE_FILE = "scene.xml"


def build_mjcf(environment: Environment) -> str:
    """Return the MJCF of a room: one box geom or light of the same name for each of its boxes and lights."""
    root = ElementTree.Element("mujoco", model=environment.name)
    world = ElementTree.SubElement(root, "worldbody")
    for light in environment.lights:
        ElementTree.SubElement(world, "light", {"name": light.name, "pos": _text(light.position_m), "dir": "0 0 -1"})
    for box in environment.boxes:
        ElementTree.SubElement(world, "geom", _geom_of(box))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _geom_of(box: Box) -> dict[str, str]:
    corners = list(zip(box.min_m, box.max_m, strict=True))
    return {
        "name": box.name,
        "type": "box",
        "pos": _text((low + high) / 2 for low, high in corners),
        "size": _text((high - low) / 2 for low, high in corners),
        "rgba": _text(box.rgba),
    }


def _text(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
