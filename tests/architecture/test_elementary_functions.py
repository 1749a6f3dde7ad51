"""Code on the path of a digest, and bundled methods, call no function whose last bit depends on the processor."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PLACES = (
    "gslcosim",
    "services",
    "agents",
    "extensions/search/gslcosim_search",
    "extensions/training/gslcosim_training/batch",
)
# What no digest and no command depends on, by file or folder.
ALLOWED = {
    "agents/dung_beetle": "rounds its places to millimetres, like its twins in other languages",
    "extensions/search/gslcosim_search/learned/row_products.py": "takes BLAS for many rows, which only training has",
    "gslcosim/base/disk_cache.py": "reads sizes that people write",
    "gslcosim/base/elementary_kernels.py": "holds the functions of the same names",
    "gslcosim/contract/record.py": "asks only whether a sum of squares is finite",
    "gslcosim/environment/store.py": "asks only whether a sum of squares is finite",
    "gslcosim/vehicles/catalogue.py": "asks only for the rank of a matrix of whole parts",
    "services/recorder": "shows what others have computed",
}
ELEMENTARY = frozenset(
    (
        "acos", "acosh", "arccos", "arccosh", "arcsin", "arcsinh", "arctan", "arctan2", "arctanh", "asin", "asinh",
        "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "dist", "erf", "erfc", "exp", "exp2", "expm1", "float_power",
        "gamma", "hypot", "lgamma", "log", "log10", "log1p", "log2", "logaddexp", "pow", "power", "sin", "sinc", "sinh",
        "tan", "tanh",
    )
)  # fmt: skip
# BLAS and LAPACK; `numpy.linalg.norm` along an axis sums in order.
LINEAR_ALGEBRA = frozenset(("dot", "einsum", "inner", "matmul", "tensordot", "vdot"))


def find_calls(text):
    """Return line and reason of each place of a module that may give other bits on another processor."""
    tree = ast.parse(text)
    compiled = [
        (node.lineno, node.end_lineno)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(each) for each in node.decorator_list)
    ]
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math" | "np" | "numpy" | "cmath"), attr=name)):
                if name in ELEMENTARY | LINEAR_ALGEBRA:
                    found.append((node.lineno, name))
            case ast.Call(func=ast.Attribute(value=ast.Attribute(attr="linalg"), attr=name)):
                if name != "norm" or not any(keyword.arg == "axis" for keyword in node.keywords):
                    found.append((node.lineno, f"linalg.{name}"))
            case ast.Call(func=ast.Name(id="pow")):
                found.append((node.lineno, "pow"))
            case ast.ImportFrom(module="math" | "numpy", names=names):
                found += [(node.lineno, each.name) for each in names if each.name in ELEMENTARY | LINEAR_ALGEBRA]
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                found.append((node.lineno, "@"))
            case ast.BinOp(op=ast.Pow(), left=base, right=exponent):
                is_whole = isinstance(exponent, ast.Constant) and isinstance(exponent.value, int)
                is_compiled = any(first <= node.lineno <= last for first, last in compiled)
                if not is_constant(node) and not (is_whole and is_compiled):
                    found.append((node.lineno, f"{ast.unparse(base)} ** {ast.unparse(exponent)}"))
            case _:
                pass
    return found


def is_constant(power):
    """Return whether a power is one of whole numbers, or one of two, which are exact."""
    try:
        base, exponent = ast.literal_eval(power.left), ast.literal_eval(power.right)
    except ValueError:
        return False
    return isinstance(exponent, int) and (isinstance(base, int) or base in (2.0, 10.0))


@pytest.mark.parametrize("place", PLACES)
def test_digests_depend_on_no_function_of_the_c_library(place):
    faults = []
    for path in sorted((ROOT / place).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if not any(name == each or name.startswith(f"{each}/") for each in ALLOWED):
            faults += [f"{name}:{line}: {what}" for line, what in find_calls(path.read_text())]
    assert not faults, "Take gslcosim.base.elementary, methods gslcosim_search.elementary; or distance, norm2 or norm3."


@pytest.mark.parametrize(
    "text",
    [
        "math.exp(1.0)", "np.sin(x)", "a @ b", "np.linalg.norm(x)", "np.linalg.solve(a, b)", "np.dot(a, b)", "x ** 2",
        "x ** 0.5", "from math import log", "pow(x, y)", "@njit\ndef f(x): return x ** 0.5",
    ],
)  # fmt: skip
def test_the_rule_finds(text):
    assert find_calls(text)


@pytest.mark.parametrize(
    "text",
    [
        "math.sqrt(x)", "np.linalg.norm(x, axis=1)", "elementary.exp(x)", "2 ** 64", "2.0 ** -52", "np.square(x)",
        "@njit\ndef f(x): return x ** 2", "x * x",
    ],
)  # fmt: skip
def test_the_rule_allows(text):
    assert not find_calls(text)


def test_exceptions_exist():
    assert all((ROOT / each).exists() for each in ALLOWED)
