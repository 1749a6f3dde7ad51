"""State has one place: attributes are born in constructors, and nobody assigns those of another object."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "gslcosim"
CONSTRUCTORS = ("__init__", "__post_init__", "__new__")
ROOMS = sorted(path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file())
# Messages of other libraries that are made by filling them in.
FOREIGN = {"scene.py", "vehicle_bodies.py"}


def modules(rooms):
    return [path for room in rooms for path in sorted((PACKAGE / room).rglob("*.py"))]


def stored(node):
    """Attributes that a function assigns, each with the name of the object."""
    targets = [
        inner
        for item in ast.walk(node)
        for inner in (ast.walk(item) if isinstance(item, ast.Attribute) else ())
        if isinstance(inner, ast.Attribute) and isinstance(inner.ctx, ast.Store)
    ]
    return {(ast.unparse(target.value), target.attr) for target in targets}


def methods(class_):
    return [item for item in class_.body if isinstance(item, ast.FunctionDef)]


def born(class_):
    names = {
        name.id
        for item in class_.body
        if isinstance(item, ast.AnnAssign | ast.Assign)
        for name in ast.walk(item)
        if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
    }
    constructors = [method for method in methods(class_) if method.name in CONSTRUCTORS]
    return names | {name for method in constructors for owner, name in stored(method) if owner == "self"}


@pytest.mark.parametrize("path", modules(ROOMS), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_attributes_are_born_in_constructors(path):
    classes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ClassDef)]
    late = {
        f"{class_.name}.{name}"
        for class_ in classes
        for method in methods(class_)
        for owner, name in stored(method)
        if owner == "self" and name not in born(class_)
    }
    assert late == set()


@pytest.mark.parametrize("path", modules(["world"]), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_nobody_assigns_attributes_of_another_object(path):
    if path.name in FOREIGN or path.name.endswith("_kernels.py"):
        pytest.skip("fills in what MuJoCo makes, or records of compiled loops")
    others = {(owner, name) for owner, name in stored(ast.parse(path.read_text())) if owner != "self"}
    assert others == set()
