"""Files of geometry: parts come as the file has them, and what is damaged is named."""

import json
import os

import numpy as np
import pytest
import trimesh

from gslcosim.base.errors import EnvironmentDataError
from gslcosim_formats.geometry.mesh_formats import load_parts

BOUNDS = [(0, 0, 0), (4, 3, 2)]


def box():
    return trimesh.creation.box(bounds=BOUNDS)


def obj_text(mesh):
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices]
    return "\n".join(lines + ["f {} {} {}".format(*face) for face in mesh.faces + 1]) + "\n"


def glb(mesh):
    return trimesh.Scene(mesh).export(file_type="glb")


MJCF = '<mujoco><worldbody><geom name="box" type="box" size="2 1.5 1" pos="2 1.5 1"/></worldbody></mujoco>'
CONTENTS = {
    "box.stl": lambda: box().export(file_type="stl"),
    "text.stl": lambda: box().export(file_type="stl_ascii").encode(),
    "box.obj": lambda: obj_text(box()).encode(),
    "box.glb": lambda: glb(box()),
    "box.xml": lambda: MJCF.encode(),
}


def load(path, *, scale=1.0, up="z", translate_m=(0.0, 0.0, 0.0)):
    return load_parts(path, scale=scale, up=up, translate_m=translate_m)


def write(tmp_path, name, content=None):
    (tmp_path / name).write_bytes(CONTENTS[name]() if content is None else content)
    return tmp_path / name


def refusal(path):
    with pytest.raises(EnvironmentDataError) as error:
        load(path)
    return str(error.value)


def extent(parts):
    corners_m = np.concatenate([part.vertices_m[part.faces] for part in parts]).reshape(-1, 3)
    return corners_m.min(axis=0).tolist(), corners_m.max(axis=0).tolist()


@pytest.mark.parametrize("name", CONTENTS)
def test_a_box_of_each_format_has_its_twelve_triangles(tmp_path, name):
    (part,) = load(write(tmp_path, name))
    assert part.faces.shape == (12, 3)
    assert extent([part]) == ([0, 0, 0], [4, 3, 2])


def test_gltf_points_up_along_y_unless_set_otherwise(tmp_path):
    path = write(tmp_path, "box.glb")
    assert extent(load(path, up=None)) == ([0, -2, 0], [4, 0, 3])
    assert extent(load(path, up="z")) == ([0, 0, 0], [4, 3, 2])


def test_parts_are_scaled_then_turned_then_moved(tmp_path):
    parts = load(write(tmp_path, "box.stl"), scale=0.5, up="y", translate_m=(10, 0, 1))
    assert extent(parts) == ([10, -1, 1], [12, 0, 2.5])


def test_nodes_of_gltf_stand_where_the_scene_has_them_in_their_colour(tmp_path):
    mesh = box()
    material = trimesh.visual.material.PBRMaterial(name="brass", baseColorFactor=[255, 51, 0, 102])
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    scene = trimesh.Scene()
    for name, x_m in (("left", 0.0), ("right", 10.0)):
        scene.add_geometry(
            mesh, node_name=name, geom_name="crate", transform=trimesh.transformations.translation_matrix((x_m, 0, 0))
        )
    parts = load(write(tmp_path, "two.glb", scene.export(file_type="glb")))
    assert [(part.name, extent([part])[0][0]) for part in parts] == [("left", 0), ("right", 10)]
    assert parts[0].names == {"left", "crate", "brass"}
    assert parts[0].rgba == (1.0, 0.2, 0.0, 0.4)


@pytest.mark.parametrize(
    ("geom", "volume", "half"),
    [
        ('type="box" size="1 2 3"', 48, (1, 2, 3)),
        ('type="sphere" size="1"', 4 / 3 * np.pi, (1, 1, 1)),
        ('type="ellipsoid" size="1 2 0.5"', 4 / 3 * np.pi, (1, 2, 0.5)),
        ('type="cylinder" size="1 2"', 4 * np.pi, (1, 1, 2)),
        ('type="capsule" size="0.5 2"', np.pi + np.pi / 6, (0.5, 0.5, 2.5)),
    ],
)
def test_geoms_of_mjcf_are_closed_and_have_their_volume(tmp_path, geom, volume, half):
    text = f'<mujoco><worldbody><body name="b" pos="5 0 0"><geom {geom}/></body></worldbody></mujoco>'
    (part,) = load(write(tmp_path, "geom.xml", text.encode()))
    mesh = trimesh.Trimesh(part.vertices_m, part.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.02)
    low, high = extent([part])
    assert np.subtract(high, (5, 0, 0)) == pytest.approx(half, rel=0.01)
    assert np.subtract((5, 0, 0), low) == pytest.approx(half, rel=0.01)
    assert part.names == {"b"}


def test_geoms_of_mjcf_are_turned_and_planes_have_their_size(tmp_path):
    text = (
        '<mujoco><worldbody><geom name="ground" type="plane" size="3 4 1"/>'
        '<geom name="beam" type="box" size="2 0.1 0.1" euler="0 0 90"/></worldbody></mujoco>'
    )
    ground, beam = load(write(tmp_path, "two.xml", text.encode()))
    assert extent([ground]) == ([-3, -4, 0], [3, 4, 0])
    assert extent([beam])[1] == pytest.approx([0.1, 2, 0.1])


@pytest.mark.parametrize("name", CONTENTS)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.93])
def test_a_truncated_file_is_named(tmp_path, name, share):
    content = CONTENTS[name]()
    if name == "box.obj":
        # Text without a length: what is missing shows where a face has lost a corner.
        content = content[: content.index(b"f") + 4] if share else b""
    text = refusal(write(tmp_path, name, content if name == "box.obj" else content[: int(share * len(content))]))
    assert text.startswith(f"{name}: expected ")
    assert str(tmp_path / name) in text


@pytest.mark.parametrize("name", CONTENTS)
def test_a_file_of_something_else_is_named(tmp_path, name):
    content = bytes(np.random.default_rng(1).integers(1, 255, size=4000, dtype=np.uint8))
    assert refusal(write(tmp_path, name, content)).startswith(f"{name}: expected ")


@pytest.mark.parametrize("name", ["empty.stl", "empty.obj", "empty.glb"])
def test_a_file_without_triangles_is_named(tmp_path, name):
    points = trimesh.Scene(trimesh.PointCloud([(0, 0, 0), (1, 1, 1)])).export(file_type="glb")
    content = {"stl": bytes(84), "obj": b"v 0 0 0\nv 1 0 0\n", "glb": points}
    assert f"{name}: expected" in refusal(write(tmp_path, name, content[name[-3:]]))


def test_vertices_that_are_not_finite_are_named(tmp_path):
    mesh = box()
    content = bytearray(mesh.export(file_type="stl"))
    content[84 + 12 : 84 + 16] = np.float32(np.nan).tobytes()
    text = refusal(write(tmp_path, "nan.stl", bytes(content)))
    assert "expected finite vertices, was 1 that are not, the first number 0" in text


def test_a_face_of_a_vertex_that_there_is_not_is_named(tmp_path):
    assert refusal(write(tmp_path, "bad.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")).startswith("bad.obj: expected")


def test_a_missing_file_and_an_unknown_ending_are_named(tmp_path):
    assert "nowhere.stl: expected a file of geometry, was no such file" in refusal(tmp_path / "nowhere.stl")
    (tmp_path / "folder.stl").mkdir()
    assert "was a folder" in refusal(tmp_path / "folder.stl")
    assert "expected a file of .stl, .obj, .glb, .gltf, .xml, was .dwg" in refusal(tmp_path / "plan.dwg")


SQUARES = ("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n", "v 2 0 0\nv 3 0 0\nv 3 1 0\nv 2 1 0\n")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("f -4 -3 -2 -1", "f -4 -3 -2 -1"),
        ("f 1 2 3 4", "f -4 -3 -2 -1"),
        ("vt 0 0\nvn 0 0 1\nf -4/-1/-1 -3/-1/-1 -2/-1/-1 -1/-1/-1", "vn 0 0 1\nf -4//-1 -3//-1 -2//-1 -1//-1"),
        ("vt 0 0\nf -4/1 -3/1 -2/1 -1/1", "f -4/-1 -3/-1 -2/-1 -1/-1"),
        ("f 1 2 3\nf 1 3 4", "f -4 -3 \\\n -2 -1"),
        ("f\t1\t2\t3\t4  # quad", "f  5  6 7   8 "),
        ("mtllib missing.mtl\nusemtl red\nf 1 2 3 4", "s off\nl -1 -2\nf 5 6 7 8"),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_faces_of_obj_have_the_vertices_that_their_indices_mean_at_their_line(tmp_path, first, second, end):
    text = f"o one\n{SQUARES[0]}{first}\no two\n{SQUARES[1]}{second}\n".replace("\n", end)
    one, two = load(write(tmp_path, "squares.obj", text.encode()))
    assert extent([one]) == ([0, 0, 0], [1, 1, 0])
    assert extent([two]) == ([2, 0, 0], [3, 1, 0])
    assert ("one" in one.names, "two" in two.names) == (True, True)


@pytest.mark.parametrize("index", ["0", "-5"])
def test_an_index_that_obj_does_not_have_is_named(tmp_path, index):
    text = f"{SQUARES[0]}f {index} 1 2\n"
    assert f"a face with index {index}" in refusal(write(tmp_path, "bad.obj", text.encode()))


# Corners in a plane, their order, and the area within.
FACES = {
    "L": ([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], 3),
    "U": ([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], 7),
    "arrow": ([(0, 0), (2, 1), (0, 2), (1, 1)], 1),
    "comb": ([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)], 8),
    "corner on an edge": ([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 1)], 3),
    "hole": ([(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)], 8),
    "square": ([(0, 0), (2, 0), (2, 2), (0, 2)], 4),
}  # fmt: skip
PLANES = {"z": lambda p, q: (p, q, 0), "x": lambda p, q: (5, p, q), "y": lambda p, q: (p, -1, q),
          "slope": lambda p, q: (p, 0.6 * q, 0.8 * q)}  # fmt: skip


@pytest.mark.parametrize("name", FACES)
@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("step", [1, -1])
def test_a_face_of_obj_covers_its_area_whatever_its_shape(tmp_path, name, plane, step):
    """Whichever corner comes first; all triangles look to the side that the face looks to."""
    corners, area = FACES[name]
    corners = corners[::step]
    for first in range(len(corners)):
        turned = corners[first:] + corners[:first]
        lines = ["v {} {} {}".format(*PLANES[plane](*corner)) for corner in turned]
        text = "\n".join([*lines, "f " + " ".join(str(i + 1) for i in range(len(corners)))])
        (part,) = load(write(tmp_path, "face.obj", text.encode()))
        mesh = trimesh.Trimesh(part.vertices_m, part.faces, process=False)
        assert mesh.area == pytest.approx(area)
        assert np.ptp(mesh.face_normals[mesh.area_faces > 0], axis=0) == pytest.approx(0, abs=1e-9)


def test_a_face_of_obj_whose_edges_cross_is_named(tmp_path):
    text = "v 0 0 0\nv 2 2 0\nv 2 0 0\nv 0 1 0\nf 1 2 3 4\n"
    assert "a face of 4 corners whose edges cross" in refusal(write(tmp_path, "bow.obj", text.encode()))


@pytest.mark.parametrize(
    ("lines", "names"),
    [
        ("g north door", {"north", "door"}),
        ("o wall_outlet", {"wall_outlet"}),
        ("o hall\ng wall_outlet", {"hall", "wall_outlet"}),
        ("g outlet_2\nusemtl wall_paint", {"outlet_2", "wall_paint"}),
    ],
)
def test_a_part_of_obj_has_the_names_of_its_lines_and_no_others(tmp_path, lines, names):
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    text = f"{square}g\nf 1 2 3\n{lines}\nf 1 2 3 4\ng wall\nf 1 3 4\ng outlet\nusemtl paint\nf 2 3 4\n"
    (part,) = [part for part in load(write(tmp_path, "named.obj", text.encode())) if len(part.faces) == 2]
    assert names <= part.names
    assert not part.names & {"wall", "outlet", "paint"}


def test_obj_has_colours_of_materials_or_vertices(tmp_path):
    (tmp_path / "room.mtl").write_text("newmtl red\nKd 1 0 0\n")
    colored = "".join(f"v {corner} 0 0.2 1\n" for corner in ("0 0 0", "1 0 0", "0 1 0"))
    text = f"mtllib room.mtl\n{colored}f 1 2 3\n"
    assert load(write(tmp_path, "room.obj", text.encode()))[0].rgba == (0, 0.2, 1, 1)
    text = text.replace("f 1", "usemtl red\nf 1")
    assert load(write(tmp_path, "room.obj", text.encode()))[0].rgba == (1, 0, 0, 1)


def solid(name, x):
    corners = [(x, 0, 0), (x + 1, 0, 0), (x + 1, 1, 0)]
    vertices = "".join("vertex {} {} {}\n".format(*corner) for corner in corners)
    return f"solid {name}\nfacet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\nendsolid {name}\n"


@pytest.mark.parametrize("names", [("outlet", "outlet"), ("", ""), ("a", "b"), ("north wall", "facet"), ("A", "A_1")])
def test_all_solids_of_a_text_are_parts(tmp_path, names):
    text = "".join(solid(name, 2 * i) for i, name in enumerate(names))
    parts = load(write(tmp_path, "solids.stl", text.encode()))
    assert sorted(extent([part])[0][0] for part in parts) == [0, 2]
    for i, name in enumerate(names):
        if name:
            held = [extent([part])[0][0] for part in parts if name in part.names]
            assert held == ([0, 2] if names[0] == names[1] else [2 * i])


@pytest.mark.parametrize("head", [b"solid made by CAD", b"solid facet room", b"solid x\nfacet normal 0 0 1"])
def test_a_binary_stl_may_begin_as_a_text(tmp_path, head):
    content = box().export(file_type="stl")
    (part,) = load(write(tmp_path, "box.stl", head.ljust(80) + content[80:]))
    assert extent([part]) == ([0, 0, 0], [4, 3, 2])


NAMED = {
    "mesh.xml": '<asset><mesh name="m" file="x"/></asset><worldbody><geom type="mesh" mesh="m"/></worldbody>',
    "folder.xml": '<compiler meshdir="below"/><asset><mesh name="m" file="x.stl"/></asset>',
    "path.xml": '<compiler strippath="true"/><asset><mesh name="m" file="nowhere/x"/></asset>',
    "texture.xml": '<asset><texture name="t" type="cube" fileright="x" fileup=\'x\'/></asset>',
    "field.xml": '<asset><hfield name="h" file="x" size="1 1 1 1"/></asset>',
    "entity.xml": '<asset><mesh name="m" file="&#120;"/></asset>',
    "include.xml": '<include file="included"/>',
    "material.obj": "mtllib x\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "texture.obj": "mtllib texture\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n",
    "buffer.gltf": json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36, "uri": "x"}],
    }),
}  # fmt: skip


@pytest.mark.parametrize("name", NAMED)
def test_a_pipe_that_a_file_of_geometry_names_is_refused(tmp_path, name):
    """Libraries open what a file names, and would wait for ever."""
    (tmp_path / "below").mkdir()
    for pipe in ("x", "below/x.stl"):
        os.mkfifo(tmp_path / pipe)
    (tmp_path / "included").write_text('<mujocoinclude><asset><mesh name="m" file="x"/></asset></mujocoinclude>')
    (tmp_path / "texture").write_text("newmtl a\nmap_Kd x\n")
    text = f"<mujoco>{NAMED[name]}</mujoco>" if name.endswith(".xml") else NAMED[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(EnvironmentDataError, match="a pipe and no file"):
        load_parts(tmp_path / name, scale=1.0, up=None, translate_m=(0.0, 0.0, 0.0))
