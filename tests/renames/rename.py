# ruff: noqa: N815, T201, E501, SIM102, PERF401, SIM108, B007, ERA001, RUF059 - a script of visitors that prints
"""Rename and merge the modules of a checkout by a map from old names to new ones.

`python tests/renames/rename.py MAP.yaml …` changes the checkout it is called in; `--check` only says what is wrong with the map.
A branch that was begun before the renaming is brought up to date by running this on it before it is rebased.
"""

import argparse
import ast
import bisect
import builtins
import json
import re
import subprocess
import sys
from collections import defaultdict
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import yaml

ROOTS = {"gslcosim": "gslcosim", "gslcosim_services": "services", "gslcosim_agents": "agents"}
CODE_FOLDERS = ("gslcosim", "services", "agents", "tests", "docs")
TEXT_SUFFIXES = {".py", ".md", ".toml", ".yaml", ".yml", ".ipynb", ".sh", ".txt", ".cfg", ""}
TEXT_FILES = ("Makefile", ".importlinter", "pyproject.toml", "Containerfile", "compose.yaml", ".ci/run")
HEAVY = {
    "zenoh",
    "rerun",
    "mujoco",
    "numba",
    "matplotlib",
    "jax",
    "scipy",
    "pydantic",
    "pyarrow",
    "PIL",
    "rich",
    "trimesh",
    "optuna",
    "ray",
    "yaml",
    "av",
    "onnxruntime",
    "gymnasium",
}
_KERNEL_PRAGMA = "# ruff: noqa: ANN001, ANN201, ANN202, N803, N806 - kernels have no types, and symbols of equations"
_OWN_IMPORT = "pass  # its import is of this module"
# The commit whose import names work for one release more.
FIRST_RELEASE = "fade3737"
_DOTTED = re.compile(r"(?<![\w./])gslcosim(?:_services|_agents)?(?:\.[A-Za-z_]\w*)+")
_PATH = re.compile(r"(?<![\w./-])(?:[A-Za-z_]\w*/)+[A-Za-z_]\w*\.py\b")


def module_path(module: str, *, package: bool = False) -> str:
    head, _, rest = module.partition(".")
    folder = ROOTS[head] + ("/" + rest.replace(".", "/") if rest else "")
    return folder + ("/__init__.py" if package else ".py")


def find_modules(root: Path) -> dict[str, Path]:
    found = {}
    for name, folder in ROOTS.items():
        for path in sorted((root / folder).rglob("*.py")):
            parts = path.relative_to(root / folder).with_suffix("").parts
            if not all(part.isidentifier() for part in parts):
                continue
            is_package = parts[-1] == "__init__"
            module = ".".join((name, *(parts[:-1] if is_package else parts)))
            found[module] = path
    return found


@dataclass
class Plan:
    modules: dict[str, str] = field(default_factory=dict)
    names: dict[str, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))
    attributes: dict[str, str] = field(default_factory=dict)
    first_lines: dict[str, str] = field(default_factory=dict)
    tests: dict[str, str] = field(default_factory=dict)


def load_plan(files: list[Path], problems: list[str]) -> Plan:
    plan = Plan()
    for file in files:
        data = yaml.safe_load(file.read_text()) or {}
        for old, new in (data.get("modules") or {}).items():
            if plan.modules.get(old, new) != new:
                problems.append(f"{file.name}: {old} goes to {plan.modules[old]} and to {new}")
            plan.modules[old] = new or old
        for key, new in (data.get("names") or {}).items():
            module, _, name = key.partition(":")
            plan.names[module][name] = new
        for old, new in (data.get("attributes") or {}).items():
            if plan.attributes.get(old, new) != new:
                problems.append(f"{file.name}: attribute {old} becomes {plan.attributes[old]} and {new}")
            plan.attributes[old] = new
        plan.first_lines.update(data.get("first_lines") or {})
        plan.tests.update(data.get("tests") or {})
    return plan


# ---------------------------------------------------------------------------------------------------------------- scopes


class Scope:
    def __init__(self, kind: str, parent: "Scope | None") -> None:
        self.kind, self.parent = kind, parent
        self.bound: set[str] = set()
        self.globals: set[str] = set()
        self.nonlocals: set[str] = set()
        self.uses: list[tuple[ast.AST, str, int, int]] = []  # node, name, line, col (bytes)

    def chain(self):
        scope = self
        first = True
        while scope is not None:
            if first or scope.kind != "class":
                yield scope
            first = False
            scope = scope.parent


class Scopes(ast.NodeVisitor):
    """Which scope binds each name that a module uses."""

    def __init__(self, tree: ast.Module, source: "Source") -> None:
        self.source = source
        self.module = Scope("module", None)
        self.current = self.module
        self.uses: list[tuple[Scope, str, int, int]] = []
        self.imports: list[tuple[Scope, ast.ImportFrom | ast.Import]] = []
        self.annotations: list[tuple[Scope, ast.Constant]] = []
        for node in tree.body:
            self.visit(node)

    def use(self, name: str, line: int, col: int) -> None:
        self.uses.append((self.current, name, line, col))

    def bind(self, name: str) -> None:
        if name not in self.current.globals | self.current.nonlocals:
            self.current.bound.add(name)

    def resolve(self, scope: Scope, name: str) -> Scope | None:
        for each in scope.chain():
            if name in each.globals:
                return self.module
            if name in each.bound:
                return each
        return None

    def visit_Name(self, node: ast.Name) -> None:
        if isinstance(node.ctx, (ast.Store, ast.Del)):
            target = self.current
            if target.kind == "comprehension_walrus":
                target = target.parent
            self.bind(node.id)
        self.use(node.id, node.lineno, node.col_offset)

    def visit_Global(self, node: ast.Global) -> None:
        self.current.globals.update(node.names)
        self.current.bound -= set(node.names)
        text = self.source.segment(node)
        at = len("global")
        for name in node.names:
            at = text.index(name, at)
            self.use(name, node.lineno, node.col_offset + len(text[:at].encode()))
            at += len(name)

    def visit_Nonlocal(self, node: ast.Nonlocal) -> None:
        self.current.nonlocals.update(node.names)

    def _annotation(self, node: ast.AST | None) -> None:
        if node is None:
            return
        for each in ast.walk(node):
            if isinstance(each, ast.Constant) and isinstance(each.value, str):
                self.annotations.append((self.current, each))
        self.visit(node)

    def _function(self, node, is_lambda: bool = False) -> None:
        args = node.args
        for default in [*args.defaults, *args.kw_defaults]:
            if default is not None:
                self.visit(default)
        every = [*args.posonlyargs, *args.args, *args.kwonlyargs, *filter(None, (args.vararg, args.kwarg))]
        if not is_lambda:
            for decorator in node.decorator_list:
                self.visit(decorator)
            for arg in every:
                self._annotation(arg.annotation)
            self._annotation(node.returns)
            self.bind(node.name)
            line, col = self.source.name_position(node)
            self.use(node.name, line, col)
        outer, self.current = self.current, Scope("function", self.current)
        for arg in every:
            self.bind(arg.arg)
            self.use(arg.arg, arg.lineno, arg.col_offset)
        for each in [node.body] if is_lambda else node.body:
            self.visit(each)
        self.current = outer

    def visit_FunctionDef(self, node) -> None:
        self._function(node)

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_Lambda(self, node) -> None:
        self._function(node, is_lambda=True)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for each in [*node.decorator_list, *node.bases, *(k.value for k in node.keywords)]:
            for inner in ast.walk(each):
                if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
                    self.annotations.append((self.current, inner))
            self.visit(each)
        self.bind(node.name)
        line, col = self.source.name_position(node)
        self.use(node.name, line, col)
        outer, self.current = self.current, Scope("class", self.current)
        for each in node.body:
            self.visit(each)
        self.current = outer

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self._annotation(node.annotation)
        self.visit(node.target)
        if node.value is not None:
            self.visit(node.value)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        # Callable[["Type"], None] in an alias
        for each in ast.walk(node.slice):
            if isinstance(each, ast.Constant) and isinstance(each.value, str) and each.value.isidentifier():
                self.annotations.append((self.current, each))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        # cast("Type", x), TypeVar("T", bound="Type")
        for arg in [*node.args, *(k.value for k in node.keywords)]:
            name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            if name in ("cast", "TypeVar") and isinstance(arg, ast.Constant) and isinstance(arg.value, str):
                self.annotations.append((self.current, arg))
        self.generic_visit(node)

    def _comprehension(self, node, *parts) -> None:
        first = node.generators[0]
        self.visit(first.iter)
        outer, self.current = self.current, Scope("function", self.current)
        for i, generator in enumerate(node.generators):
            self.visit(generator.target)
            if i:
                self.visit(generator.iter)
            for test in generator.ifs:
                self.visit(test)
        for part in parts:
            self.visit(part)
        self.current = outer

    def visit_ListComp(self, node) -> None:
        self._comprehension(node, node.elt)

    visit_SetComp = visit_GeneratorExp = visit_ListComp

    def visit_DictComp(self, node) -> None:
        self._comprehension(node, node.key, node.value)

    def visit_NamedExpr(self, node: ast.NamedExpr) -> None:
        self.visit(node.value)
        self.visit(node.target)

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> None:
        if node.name:
            self.bind(node.name)
        self.generic_visit(node)

    def visit_MatchAs(self, node: ast.MatchAs) -> None:
        if node.name:
            self.bind(node.name)
        self.generic_visit(node)

    def visit_MatchStar(self, node: ast.MatchStar) -> None:
        if node.name:
            self.bind(node.name)

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            self.bind(alias.asname or alias.name.partition(".")[0])
        self.imports.append((self.current, node))

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        for alias in node.names:
            self.bind(alias.asname or alias.name)
        self.imports.append((self.current, node))


# ---------------------------------------------------------------------------------------------------------------- source


class Source:
    def __init__(self, path: Path, text: str) -> None:
        self.path, self.text = path, text
        self.data = text.encode()
        self.starts = [0]
        for line in self.data.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.tree = ast.parse(text)
        self.edits: list[tuple[int, int, str]] = []

    def at(self, line: int, col: int) -> int:
        return self.starts[line - 1] + col

    def span(self, node) -> tuple[int, int]:
        return self.at(node.lineno, node.col_offset), self.at(node.end_lineno, node.end_col_offset)

    def segment(self, node) -> str:
        start, end = self.span(node)
        return self.data[start:end].decode()

    def name_position(self, node) -> tuple[int, int]:
        start, end = self.span(node)
        word = b"class" if isinstance(node, ast.ClassDef) else b"def"
        found = re.compile(rb"\b" + word + rb"\s+(" + node.name.encode() + rb")\b").search(self.data, start, end)
        offset = found.start(1)
        line = bisect.bisect_right(self.starts, offset)
        return line, offset - self.starts[line - 1]

    def edit(self, start: int, end: int, new: str) -> None:
        self.edits.append((start, end, new))

    def overlaps(self, start: int, end: int) -> bool:
        return any(s < end and start < e for s, e, _ in self.edits)

    def result(self) -> str:
        data = self.data
        last = None
        for start, end, new in sorted(set(self.edits), reverse=True):
            if last is not None and end > last:
                raise ValueError(f"{self.path}: edits overlap at byte {start}: {data[start:end]!r} -> {new!r}")
            data = data[:start] + new.encode() + data[end:]
            last = start
        return data.decode()


def top_level_names(tree: ast.Module) -> dict[str, ast.AST]:
    found: dict[str, ast.AST] = {}

    def targets(node):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, (ast.Tuple, ast.List)):
            for each in node.elts:
                yield from targets(each)
        elif isinstance(node, ast.Starred):
            yield from targets(node.value)

    def walk(body):
        for node in body:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                found[node.name] = node
            elif isinstance(node, ast.Assign):
                for target in node.targets:
                    for name in targets(target):
                        found[name] = node
            elif isinstance(node, (ast.AnnAssign, ast.AugAssign)):
                for name in targets(node.target):
                    found[name] = node
            elif isinstance(node, (ast.If, ast.Try, ast.With, ast.For)):
                for part in ("body", "orelse", "finalbody"):
                    walk(getattr(node, part, []))
                for handler in getattr(node, "handlers", []):
                    walk(handler.body)
                if isinstance(node, ast.For):
                    for name in targets(node.target):
                        found[name] = node
                if isinstance(node, ast.With):
                    for item in node.items:
                        if item.optional_vars is not None:
                            for name in targets(item.optional_vars):
                                found[name] = node

    walk(tree.body)
    return found


class Renamer:
    def __init__(self, root: Path, plan: Plan) -> None:
        self.root, self.plan = root, plan
        self.problems: list[str] = []
        self.notes: list[str] = []
        self.old_modules = find_modules(root)
        self.sources: dict[Path, Source] = {}
        self.module_of_path = {path: module for module, path in self.old_modules.items()}
        self.defined: dict[str, dict[str, ast.AST]] = {}
        for module, path in self.old_modules.items():
            self.sources[path] = Source(path, path.read_text())
            self.defined[module] = top_level_names(self.sources[path].tree)
        self.new_of = {module: self._mapped(module) for module in self.old_modules}
        self.groups: dict[str, list[str]] = defaultdict(list)
        for module in plan.modules:
            if module in self.new_of:
                self.groups[plan.modules[module]].append(module)
        for module in self.old_modules:
            if module not in plan.modules:
                self.groups[self.new_of[module]].append(module)
        self.packages = {new.rpartition(".")[0] for new in self.new_of.values()}
        for package in list(self.packages):
            while package:
                self.packages.add(package)
                package = package.rpartition(".")[0]
        self._reexports()

    # A module that the map does not know goes where its package goes.
    def _mapped(self, module: str) -> str:
        head, tail = module, ""
        while head:
            if head in self.plan.modules:
                return self.plan.modules[head] + tail
            head, _, last = head.rpartition(".")
            tail = f".{last}{tail}"
        return module

    # A name that a module only passes on (`from x import y as y`) is renamed where it is defined.
    def _reexports(self) -> None:
        self.passed_on: dict[tuple[str, str], tuple[str, str]] = {}
        for module, path in self.old_modules.items():
            for node in ast.walk(self.sources[path].tree):
                if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("gslcosim"):
                    for alias in node.names:
                        if f"{node.module}.{alias.name}" not in self.old_modules:
                            self.passed_on[module, alias.asname or alias.name] = (node.module, alias.name)

    def definer(self, module: str, name: str) -> tuple[str, str]:
        seen = set()
        while (
            name not in self.defined.get(module, {}) and (module, name) in self.passed_on and (module, name) not in seen
        ):
            seen.add((module, name))
            module, name = self.passed_on[module, name]
        return module, name

    def new_name(self, module: str, name: str) -> str:
        home, original = self.definer(module, name)
        if original != name:  # re-exported under another name
            return name
        return self.plan.names.get(home, {}).get(original, name)

    def is_module(self, dotted: str) -> bool:
        return dotted in self.old_modules

    # ------------------------------------------------------------------------------------------------ checks of the map

    def check(self) -> None:
        for module in self.plan.modules:
            if module not in self.old_modules:
                self.notes.append(f"modules: {module} is not there")
        for module, names in self.plan.names.items():
            for name, new in names.items():
                if module not in self.old_modules:
                    self.notes.append(f"names: module {module} is not there")
                    break
                if name not in self.defined[module]:
                    self.notes.append(f"names: {module} defines no {name}")
                if not new.isidentifier():
                    self.problems.append(f"names: {module}:{name}: {new!r} is no identifier")
        for new, olds in self.groups.items():
            owners: dict[str, str] = {}
            for old in olds:
                for name in self.defined[old]:
                    renamed = self.plan.names.get(old, {}).get(name, name)
                    if renamed in owners and owners[renamed] != old:
                        first = self._definition(owners[renamed], renamed)
                        second = self._definition(old, renamed)
                        if first is None or second is None or first != second:
                            self.problems.append(
                                f"merge into {new}: {renamed} is defined in {owners[renamed]} and in {old}"
                            )
                    owners.setdefault(renamed, old)
            imported: dict[str, tuple[str, str]] = {}
            for old in olds:
                for node in self.sources[self.old_modules[old]].tree.body:
                    if isinstance(node, ast.ImportFrom):
                        for alias in node.names:
                            dotted = f"{node.module}.{alias.name}"
                            if self.is_module(dotted):
                                target = self.new_of[dotted]
                                local = alias.asname or target.rpartition(".")[2]
                                what = (target, "")
                            else:
                                home, _ = (
                                    self.definer(node.module, alias.name)
                                    if node.module in self.old_modules
                                    else (node.module, "")
                                )
                                target = self.new_of.get(home, home)
                                name = (
                                    self.new_name(node.module, alias.name)
                                    if node.module in self.old_modules
                                    else alias.name
                                )
                                local = alias.asname or name
                                what = (target, name)
                            if what[0] == new:
                                continue
                            if local in owners and owners[local] not in (None,):
                                self.problems.append(
                                    f"merge into {new}: {local}, imported by {old} from {target}, is defined in {owners[local]}"
                                )
                            if imported.get(local, what) != what:
                                self.problems.append(
                                    f"merge into {new}: {local} is imported from {imported[local]} and, by {old}, from {what}"
                                )
                            imported[local] = what
        news = set(self.new_of.values())
        for new in news:
            for i in range(1, new.count(".") + 1):
                package = new.rsplit(".", i)[0]
                if package in news and not any(self.old_modules[o].name == "__init__.py" for o in self.groups[package]):
                    self.problems.append(f"modules: {new} lies in {package}, which is a module")
        self._check_circles()
        self._heavy()

    def _definition(self, module: str, new_name: str) -> str | None:
        for name, node in self.defined[module].items():
            if self.plan.names.get(module, {}).get(name, name) == new_name:
                return (
                    ast.dump(node)
                    if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Assign, ast.AnnAssign))
                    else None
                )
        return None

    def _top_imports(self, module: str):
        source = self.sources[self.old_modules[module]]

        def walk(body):
            for node in body:
                if isinstance(node, ast.ImportFrom) and node.module:
                    for alias in node.names:
                        dotted = f"{node.module}.{alias.name}"
                        yield dotted if self.is_module(dotted) else node.module
                elif isinstance(node, ast.Import):
                    for alias in node.names:
                        yield alias.name
                elif isinstance(node, ast.If) and not (
                    isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
                ):
                    yield from walk(node.body)
                    yield from walk(node.orelse)
                elif isinstance(node, ast.Try):
                    yield from walk(node.body)
                    for handler in node.handlers:
                        yield from walk(handler.body)

        yield from walk(source.tree.body)

    def _check_circles(self) -> None:
        graph: dict[str, set[str]] = defaultdict(set)
        why: dict[tuple[str, str], str] = {}
        for module in self.old_modules:
            for target in self._top_imports(module):
                if target in self.new_of and self.new_of[target] != self.new_of[module]:
                    graph[self.new_of[module]].add(self.new_of[target])
                    why[self.new_of[module], self.new_of[target]] = f"{module} -> {target}"
        for circle in strongly_connected(graph):
            if len(circle) > 1:
                inside = [why[a, b] for a in circle for b in graph[a] if b in circle]
                self.problems.append(f"circle: {', '.join(sorted(circle))}; by {'; '.join(inside[:8])}")

    def _heavy(self) -> None:
        memo: dict[str, set[str]] = {}

        def heavy(module: str, stack=()) -> set[str]:
            if module in memo:
                return memo[module]
            if module in stack:
                return set()
            found: set[str] = set()
            for target in self._top_imports(module):
                if target in self.old_modules:
                    found |= heavy(target, (*stack, module))
                elif target.partition(".")[0] in HEAVY:
                    found.add(target.partition(".")[0])
            memo[module] = found
            return found

        for new, olds in sorted(self.groups.items()):
            union = set().union(*(heavy(old) for old in olds))
            for old in olds:
                if len(olds) > 1 and union - heavy(old):
                    self.notes.append(f"heavier: {old} in {new} now loads {', '.join(sorted(union - heavy(old)))}")

    # ------------------------------------------------------------------------------------------------ edits of one file

    def rewrite(self, path: Path) -> Source:
        source = self.sources.get(path)
        if source is None:
            source = self.sources[path] = Source(path, path.read_text())
        own = self.module_of_path.get(path)
        own_new = self.new_of.get(own) if own else None
        scopes = Scopes(source.tree, source)
        renames: dict[tuple[Scope, str], str] = {}  # (scope that binds it, local name) -> new local name
        modules: dict[tuple[Scope, str], str] = {}  # local name of an imported module -> old module
        own_modules: set[tuple[Scope, str]] = set()
        uses_by_binding: dict[tuple[Scope, str], list[tuple[Scope, int, int]]] = defaultdict(list)
        for scope, name, line, col in scopes.uses:
            home = scopes.resolve(scope, name)
            if home is not None:
                uses_by_binding[home, name].append((scope, line, col))

        def collides(home: Scope, old: str, new: str) -> bool:
            if new == old:
                return False
            if new in home.bound:
                return True
            for scope, _, _ in uses_by_binding[home, old]:
                for each in scope.chain():
                    if each is home:
                        break
                    if new in each.bound:
                        return True
            # somebody else's use of `new` that means a builtin or an outer name
            for scope, name, _, _ in scopes.uses:
                if name == new and scopes.resolve(scope, name) in (None, *list(home.chain())[1:]):
                    if home in list(scope.chain()) and hasattr(builtins, new):
                        return True
            return False

        if own:
            for name, new in self.plan.names.get(own, {}).items():
                if name not in self.defined[own] or new == name:
                    continue
                if collides(scopes.module, name, new):
                    self.problems.append(
                        f"{path.relative_to(self.root)}: {name} cannot become {new}: that name is taken there"
                    )
                    continue
                renames[scopes.module, name] = new

        for scope, node in scopes.imports:
            if isinstance(node, ast.Import):
                continue
            if node.level or not node.module or node.module.partition(".")[0] not in ROOTS:
                continue
            lines: dict[str, list[str]] = defaultdict(list)
            changed = False
            for alias in node.names:
                dotted = f"{node.module}.{alias.name}"
                local = alias.asname or alias.name
                if self.is_module(dotted):
                    target = self.new_of[dotted]
                    if target == own_new and own_new is not None and dotted != own:
                        own_modules.add((scope, local))
                        modules[scope, local] = dotted
                        changed = True
                        continue
                    modules[scope, local] = dotted
                    package, _, stem = target.rpartition(".")
                    text = stem
                    if alias.asname:
                        text = f"{stem} as {alias.asname}" if stem != alias.asname else stem
                    elif stem != alias.name:
                        previous = renames.get((scope, local))
                        if (
                            collides(scope, local, stem)
                            and previous != stem
                            and not self._same_import(scopes, scope, stem, target)
                        ):
                            text = f"{stem} as {alias.name}"
                            self.notes.append(
                                f"alias: {path.relative_to(self.root)}:{node.lineno}: {target} as {alias.name}"
                            )
                        else:
                            renames[scope, local] = stem
                    lines[package].append(text)
                    changed |= target != dotted or text != alias.name
                elif node.module in self.old_modules:
                    home, original = self.definer(node.module, alias.name)
                    target = self.new_of[node.module]
                    new = self.new_name(node.module, alias.name)
                    if (
                        home != node.module
                        and self.old_modules[node.module].name != "__init__.py"
                        and self.new_of[home] == own_new
                        and target != own_new
                    ):
                        target = own_new  # passed on by another module, and now defined here
                    if target == own_new and node.module != own:
                        if local != new:
                            renames[scope, local] = new
                            if scope is not scopes.module and any(
                                new in each.bound for each in scope.chain() if each is not scopes.module
                            ):
                                self.problems.append(
                                    f"{path.relative_to(self.root)}:{node.lineno}: {local} means {new} of this module, a name that is taken there"
                                )
                        changed = True
                        continue
                    text = new
                    if alias.asname and alias.asname != alias.name:
                        text = f"{new} as {alias.asname}"
                    elif new != alias.name:
                        if collides(scope, local, new) and renames.get((scope, local)) != new:
                            text = f"{new} as {local}"
                            self.notes.append(f"alias: {path.relative_to(self.root)}:{node.lineno}: {new} as {local}")
                        else:
                            renames[scope, local] = new
                            if alias.asname:
                                text = f"{new} as {new}"
                    elif alias.asname:
                        text = f"{new} as {new}"
                    lines[target].append(text)
                    changed |= target != node.module or text != alias.name
                else:
                    # a package without an __init__ entry, or a folder that the map does not know
                    package = self._new_package(node.module)
                    lines[package].append(alias.name if not alias.asname else f"{alias.name} as {alias.asname}")
                    changed |= package != node.module
            if changed:
                start, end = source.span(node)
                indent = " " * node.col_offset
                texts = [f"from {package} import {', '.join(dict.fromkeys(names))}" for package, names in lines.items()]
                joined = f"\n{indent}".join(texts) if texts else _OWN_IMPORT
                source.edit(start, end, joined)

        # A name that a merged sibling brings in is module-wide afterwards; local imports of it are dropped.
        for (home, name), uses in uses_by_binding.items():
            if (home, name) in modules:
                continue
            new = renames.get((home, name))
            if new is None or new == name:
                continue
            for _, line, col in uses:
                start = source.at(line, col)
                source.edit(start, start + len(name.encode()), new)
        self._module_attributes(source, scopes, modules, own_modules, renames)
        self._quoted_annotations(source, scopes, renames)
        self._all_lists(source, own)
        self._patches(source, scopes, modules)
        self._attribute_names(source)
        if own:
            self._first_lines(source, own)
        self._words(source, own, scopes)
        self._dotted(source)
        return source

    def _same_import(self, scopes: Scopes, scope: Scope, stem: str, target: str) -> bool:
        for other, node in scopes.imports:
            if other is scope and isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    dotted = f"{node.module}.{alias.name}"
                    if (alias.asname or alias.name) == stem and self.new_of.get(dotted) == target:
                        return True
        return False

    def _new_package(self, package: str) -> str:
        if package in self.new_of:
            return self.new_of[package]
        news = {self.new_of[m].rpartition(".")[0] for m in self.old_modules if m.rpartition(".")[0] == package}
        return news.pop() if len(news) == 1 else package

    def _module_attributes(self, source, scopes, modules, own_modules, renames) -> None:
        positions = {(line, col): (scope, name) for scope, name, line, col in scopes.uses}
        handled = set()
        for node in ast.walk(source.tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                at = positions.get((node.value.lineno, node.value.col_offset))
                if at is None:
                    continue
                home = scopes.resolve(*at)
                key = (home, at[1])
                if home is None or key not in modules:
                    continue
                handled.add((node.value.lineno, node.value.col_offset))
                module = modules[key]
                new = self.new_name(module, node.attr)
                start, end = source.span(node)
                base_end = source.at(node.value.end_lineno, node.value.end_col_offset)
                if key in own_modules:
                    if any(new in each.bound for each in at[0].chain() if each is not scopes.module):
                        self.problems.append(
                            f"{source.path.relative_to(self.root)}:{node.lineno}: {at[1]}.{node.attr} becomes {new}, which is a local name there"
                        )
                    source.edit(start, end, new)
                    continue
                if key in renames:
                    source.edit(start, base_end, renames[key])
                if new != node.attr:
                    source.edit(end - len(node.attr.encode()), end, new)
        # the module itself handed on
        for scope, name, line, col in scopes.uses:
            if (line, col) in handled:
                continue
            home = scopes.resolve(scope, name)
            key = (home, name)
            if home is not None and key in modules:
                if key in own_modules:
                    self.problems.append(
                        f"{source.path.relative_to(self.root)}:{line}: the module {name} is handed on within the module that it becomes"
                    )
                elif key in renames:
                    start = source.at(line, col)
                    source.edit(start, start + len(name.encode()), renames[key])

    def _quoted_annotations(self, source, scopes, renames) -> None:
        seen = set()
        for scope, node in scopes.annotations:
            if id(node) in seen:
                continue
            seen.add(id(node))
            start, end = source.span(node)
            text = source.data[start:end].decode()

            def swap(match, scope=scope):
                home = scopes.resolve(scope, match.group())
                return renames.get((home, match.group()), match.group())

            new = re.sub(r"(?<![\w.])[A-Za-z_]\w*", swap, text)
            if new != text:
                source.edit(start, end, new)

    def _all_lists(self, source, own) -> None:
        if not own:
            return
        for node in source.tree.body:
            if isinstance(node, ast.Assign) and any(
                isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets
            ):
                for each in ast.walk(node.value):
                    if isinstance(each, ast.Constant) and isinstance(each.value, str):
                        new = self.new_name(own, each.value)
                        if new != each.value:
                            start, end = source.span(each)
                            source.edit(start, end, f'"{new}"')

    def _patches(self, source, scopes, modules) -> None:
        positions = {(line, col): (scope, name) for scope, name, line, col in scopes.uses}
        for node in ast.walk(source.tree):
            if not (isinstance(node, ast.Call) and len(node.args) >= 2):
                continue
            function = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if function not in ("setattr", "getattr", "delattr", "hasattr", "object"):
                continue
            first, second = node.args[:2]
            if not (isinstance(second, ast.Constant) and isinstance(second.value, str)):
                continue
            new = self.plan.attributes.get(second.value, second.value)
            if isinstance(first, ast.Name) and (at := positions.get((first.lineno, first.col_offset))):
                key = (scopes.resolve(*at), at[1])
                if key in modules:
                    new = self.new_name(modules[key], second.value)
            if new != second.value:
                start, end = source.span(second)
                source.edit(start, end, f'"{new}"')

    def _attribute_names(self, source) -> None:
        names = self.plan.attributes
        if not names:
            return
        for node in ast.walk(source.tree):
            if isinstance(node, ast.Attribute) and node.attr in names:
                _, end = source.span(node)
                start = end - len(node.attr.encode())
                if not source.overlaps(start, end):
                    source.edit(start, end, names[node.attr])
            elif isinstance(node, ast.ClassDef):
                for each in node.body:
                    if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef)) and each.name in names:
                        start = source.at(*source.name_position(each))
                        source.edit(start, start + len(each.name.encode()), names[each.name])
                    elif (
                        isinstance(each, ast.AnnAssign)
                        and isinstance(each.target, ast.Name)
                        and each.target.id in names
                    ):
                        start, end = source.span(each.target)
                        source.edit(start, end, names[each.target.id])
                    elif isinstance(each, ast.Assign):
                        for target in each.targets:
                            if isinstance(target, ast.Name) and target.id in names:
                                start, end = source.span(target)
                                source.edit(start, end, names[target.id])
            elif isinstance(node, ast.Call):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
                if called[:1].isupper() or called in ("replace", "_replace", "model_copy", "structs_replace"):
                    for keyword in node.keywords:
                        if keyword.arg in names:
                            start = source.at(keyword.lineno, keyword.col_offset)
                            source.edit(start, start + len(keyword.arg.encode()), names[keyword.arg])

    def _first_lines(self, source, own) -> None:
        def replace(node, text: str, where: str) -> None:
            body = node.body
            if not (
                body
                and isinstance(body[0], ast.Expr)
                and isinstance(body[0].value, ast.Constant)
                and isinstance(body[0].value.value, str)
            ):
                self.notes.append(f"first_lines: {where} has no docstring")
                return
            start, end = source.span(body[0].value)
            old = source.data[start:end].decode()
            quote = re.match(r'[rRuU]*("""|\'\'\'|"|\')', old)
            head, rest = old[: quote.end()], old[quote.end() :]
            # the summary ends at the first empty line or at the closing quotes
            stop = re.search(r"\n[ \t]*\n|(?:\n[ \t]*)?" + re.escape(quote.group(1)) + r"\Z", rest)
            source.edit(start, end, head + text.strip() + rest[stop.start() :])

        def walk(body, prefix):
            for node in body:
                if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                    qualname = f"{prefix}{node.name}"
                    text = self.plan.first_lines.get(f"{own}:{qualname}") or self._plain_predicate(node)
                    if text:
                        replace(node, text, f"{own}:{qualname}")
                    if isinstance(node, ast.ClassDef):
                        walk(node.body, f"{qualname}.")

        walk(source.tree.body, "")
        text = self.plan.first_lines.get(self.new_of[own])
        if text and len(self.groups[self.new_of[own]]) == 1:
            replace(source.tree, text, own)

    def _plain_predicate(self, node) -> str | None:
        doc = (ast.get_docstring(node) or "").partition("\n\n")[0]
        if doc.startswith("Whether "):
            return "True if " + doc.removeprefix("Whether ")
        many = re.fullmatch(r"How many (.+?) there are\.", doc)
        return f"Number of {many.group(1)}." if many else None

    def _words(self, source, own, scopes) -> None:
        """Rename in comments and docstrings what the file defines or imports, where it cannot be an everyday word."""
        words: dict[str, str] = {}
        if own:
            words |= self.plan.names.get(own, {})
        for _, node in scopes.imports:
            if isinstance(node, ast.ImportFrom) and node.module in self.old_modules:
                for alias in node.names:
                    new = self.new_name(node.module, alias.name)
                    if new != alias.name:
                        words[alias.name] = new
        clear = {
            old: new
            for old, new in words.items()
            if old != new and ("_" in old.strip("_") or re.search(r"[a-z][A-Z]", old))
        }
        ticked = {old: new for old, new in words.items() if old != new}
        attributes = self.plan.attributes
        for start, end in self._prose(source):
            text = source.data[start:end].decode()
            new = text
            if clear:
                new = re.sub(
                    r"(?<![\w.])(" + "|".join(map(re.escape, sorted(clear, key=len, reverse=True))) + r")\b(?!=)",
                    lambda m: clear[m.group()],
                    new,
                )
            if ticked or attributes:

                def tick(match):
                    inner = match.group(1)
                    inner = re.sub(r"(?<![\w.])[A-Za-z_]\w*", lambda m: ticked.get(m.group(), m.group()), inner)
                    inner = re.sub(r"(?<=\.)[A-Za-z_]\w*", lambda m: attributes.get(m.group(), m.group()), inner)
                    return f"`{inner}`"

                new = re.sub(r"`([^`\n]+)`", tick, new)
            if new != text and not source.overlaps(start, end):
                new = self._map_dotted(new)
                source.edit(start, end, new)

    def _prose(self, source):
        import io
        import tokenize

        for token in tokenize.generate_tokens(io.StringIO(source.text).readline):
            if token.type == tokenize.COMMENT:
                line, col = token.start
                text_line = source.text.splitlines()[line - 1]
                start = source.at(line, len(text_line[:col].encode()))
                yield start, start + len(token.string.encode())
        for node in ast.walk(source.tree):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
                body = node.body
                if (
                    body
                    and isinstance(body[0], ast.Expr)
                    and isinstance(body[0].value, ast.Constant)
                    and isinstance(body[0].value.value, str)
                ):
                    yield source.span(body[0].value)

    def _dotted(self, source) -> None:
        for pattern, function in ((_DOTTED, self._map_dotted), (_PATH, self._map_path)):
            for match in pattern.finditer(source.text):
                start = len(source.text[: match.start()].encode())
                end = start + len(match.group().encode())
                new = function(match.group())
                if new != match.group() and not source.overlaps(start, end):
                    source.edit(start, end, new)

    def _map_dotted(self, text: str) -> str:
        def swap(match):
            parts = match.group().split(".")
            for n in range(len(parts), 0, -1):
                module = ".".join(parts[:n])
                if module in self.new_of:
                    is_package = self.old_modules[module].name == "__init__.py"
                    rest = parts[n:]
                    new = self.new_of[module]
                    if (
                        rest
                        and is_package
                        and rest[0] not in self.defined[module]
                        and (module, rest[0]) not in self.passed_on
                    ):
                        new = self._new_package_of_text(module, new)
                    if rest:
                        rest = [self.new_name(module, rest[0]), *(self.plan.attributes.get(r, r) for r in rest[1:])]
                    return ".".join([new, *rest])
            return match.group()

        return _DOTTED.sub(swap, text)

    def _new_package_of_text(self, module: str, new: str) -> str:
        return new

    def _map_path(self, text: str) -> str:
        if (test := self.root / text) in self._moved_tests:
            return self._moved_tests[test].relative_to(self.root).as_posix()
        for head, prefix in (("", ""), ("gslcosim/", "gslcosim/")):
            path = self.root / (head + text)
            module = self.module_of_path.get(path)
            if module is not None:
                new = self.new_of[module]
                is_package = path.name == "__init__.py" and self._is_package(new)
                found = module_path(new, package=is_package)
                if head and found.startswith(prefix):
                    found = found.removeprefix(prefix)
                return found
        return text

    def _is_package(self, new: str) -> bool:
        return new in self.packages

    # ------------------------------------------------------------------------------------------------ the whole checkout

    def run(self) -> None:
        outputs: dict[Path, str] = {}
        removed: set[Path] = set()
        rewritten: dict[str, str] = {}
        for module, path in self.old_modules.items():
            rewritten[module] = self.rewrite(path).result()
        others = []
        for folder in CODE_FOLDERS:
            for path in sorted((self.root / folder).rglob("*.py")):
                if (
                    path not in self.module_of_path
                    and ".venv" not in path.parts
                    and "target" not in path.parts
                    and "node_modules" not in path.parts
                ):
                    others.append(path)
        for path in others:
            try:
                source = self.rewrite(path)
            except SyntaxError:
                continue
            outputs[path] = source.result()
        if self.problems:
            return
        for new, olds in self.groups.items():
            is_package = self._is_package(new) or any(self.old_modules[o].name == "__init__.py" for o in olds)
            is_package = is_package and (
                self._is_package(new) or (len(olds) == 1 and self.old_modules[olds[0]].name == "__init__.py")
            )
            target = self.root / module_path(new, package=is_package)
            if len(olds) == 1:
                text = rewritten[olds[0]]
            else:
                text = self.merge(new, olds, rewritten)
            if target in outputs:
                self.problems.append(f"{target} is written twice")
            outputs[target] = text
            removed |= {self.old_modules[o] for o in olds if self.old_modules[o] != target}
        if self.problems:
            return
        self._write(outputs, removed)

    def merge(self, new: str, olds: list[str], rewritten: dict[str, str]) -> str:
        order = self._order(new, olds)
        docs, pragmas, imports, typing_imports, bodies = [], [], [], [], []
        seen_definitions: dict[str, str] = {}
        for old in order:
            text = rewritten[old]
            tree = ast.parse(text)
            lines = text.splitlines()
            drop: set[int] = set()
            body = tree.body
            if (
                body
                and isinstance(body[0], ast.Expr)
                and isinstance(body[0].value, ast.Constant)
                and isinstance(body[0].value.value, str)
            ):
                docs.append((old, ast.get_docstring(tree, clean=True)))
                drop.update(range(body[0].lineno, body[0].end_lineno + 1))
                body = body[1:]
            for number, line in enumerate(lines, 1):
                if re.match(r"# (pyright|ruff):", line):
                    pragmas.append(line)
                    drop.add(number)
            if "kernels" in old.rpartition(".")[2] and "kernels" not in new.rpartition(".")[2]:
                # pyproject.toml lets files of that name have symbols and no types
                pragmas.append(_KERNEL_PRAGMA)
            for node in body:
                if isinstance(node, (ast.Import, ast.ImportFrom)):
                    first = node.lineno
                    while first > 1 and lines[first - 2].startswith("#") and first - 1 not in drop:
                        first -= 1
                    imports.append("\n".join(lines[first - 1 : node.end_lineno]))
                    drop.update(range(first, node.end_lineno + 1))
                elif isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
                    for each in node.body:
                        if isinstance(each, ast.Pass):
                            continue
                        typing_imports.append("\n".join(line[4:] for line in lines[each.lineno - 1 : each.end_lineno]))
                    drop.update(range(node.lineno, node.end_lineno + 1))
                elif isinstance(node, ast.Pass):
                    drop.update(range(node.lineno, node.end_lineno + 1))
                else:
                    names = (
                        [node.name]
                        if isinstance(node, (ast.FunctionDef, ast.ClassDef))
                        else (
                            [t.id for t in node.targets if isinstance(t, ast.Name)]
                            if isinstance(node, ast.Assign)
                            else [node.target.id]
                            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
                            else []
                        )
                    )
                    if len(names) == 1:
                        dump = ast.dump(node)
                        if seen_definitions.get(names[0]) == dump:
                            first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", []))])
                            while first > 1 and lines[first - 2].startswith("#"):
                                first -= 1
                            drop.update(range(first, node.end_lineno + 1))
                        seen_definitions[names[0]] = dump
            kept = [line for number, line in enumerate(lines, 1) if number not in drop]
            bodies.append("\n".join(kept).strip("\n"))
        summary = self.plan.first_lines.get(new)
        paragraphs = []
        for old, doc in docs:
            head, _, rest = (doc or "").partition("\n\n")
            if summary is None:
                summary = " ".join(head.split("\n"))
                self.notes.append(f"docstring: {new} has no first line in the map")
            if rest.strip():
                # What a module tells further is of what its first line names.
                is_namesake = old.rpartition(".")[2] == new.rpartition(".")[2] or len(docs) == 1
                paragraphs += [rest.strip()] if is_namesake else [head.strip(), rest.strip()]
        doc = '"""' + "\n\n".join([summary or "", *paragraphs]) + ("\n" if paragraphs else "") + '"""'
        runtime = "\n".join(self._without_repeated_names(list(dict.fromkeys(imports))))
        parts = [*_join_pragmas(pragmas), doc, ""]
        if typing_imports and "TYPE_CHECKING" not in runtime:
            runtime += "\nfrom typing import TYPE_CHECKING"
        parts += [runtime, ""]
        have = self._bound_by(runtime)
        rest = []
        for statement in dict.fromkeys(typing_imports):
            node = ast.parse(statement).body[0]
            if isinstance(node, ast.ImportFrom):
                names = [a for a in node.names if (a.asname or a.name) not in have]
                if not names:
                    continue
                statement = f"from {node.module} import " + ", ".join(
                    a.name + (f" as {a.asname}" if a.asname else "") for a in names
                )
            rest.append("    " + statement.replace("\n", "\n    "))
        if rest:
            parts += ["if TYPE_CHECKING:", *rest, ""]
        parts += ["\n\n\n".join(body for body in bodies if body)]
        return "\n".join(parts) + "\n"

    # One object that is imported from two modules, of which one passes it on: the first import serves.
    def _without_repeated_names(self, imports: list[str]) -> list[str]:
        bound: dict[str, str] = {}
        kept = []
        for text in imports:
            node = ast.parse(text).body[0]
            if isinstance(node, ast.ImportFrom):
                names = [a for a in node.names if bound.get(a.asname or a.name, node.module) == node.module]
                for alias in names:
                    bound[alias.asname or alias.name] = node.module
                if len(names) < len(node.names):
                    if not names:
                        continue
                    text = f"from {node.module} import " + ", ".join(
                        a.name + (f" as {a.asname}" if a.asname else "") for a in names
                    )
            kept.append(text)
        return kept

    def _bound_by(self, text: str) -> set[str]:
        found = set()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                found |= {a.asname or a.name.partition(".")[0] for a in node.names}
        return found

    def _order(self, new: str, olds: list[str]) -> list[str]:
        needs = {old: {t for t in self._top_imports(old) if t in olds and t != old} for old in olds}
        order: list[str] = []

        def add(old: str, stack: tuple[str, ...]) -> None:
            if old in order or old in stack:
                return
            for other in olds:
                if other in needs[old]:
                    add(other, (*stack, old))
            order.append(old)

        for old in olds:
            add(old, ())
        return order

    def _write(self, outputs: dict[Path, str], removed: set[Path]) -> None:
        tests = self._moved_tests
        for path in removed:
            if path not in outputs:
                path.unlink()
        for path, text in outputs.items():
            path = tests.get(path, path)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(drop_passes(text))
        for old, new in tests.items():
            if old != new and old.exists() and old not in outputs.values():
                if old in outputs:
                    old.unlink()
        self._move_data_files()
        self._text_files()
        self._old_names()
        for folder in ROOTS.values():
            self._packages(self.root / folder)
            remove_empty(self.root / folder)
        remove_empty(self.root / "tests")

    @cached_property
    def _moved_tests(self) -> dict[Path, Path]:
        moves: dict[Path, Path] = {self.root / a: self.root / b for a, b in self.plan.tests.items()}
        taken = set(moves.values())
        for new, olds in self.groups.items():
            for old in olds:
                if old == new and len(olds) == 1:
                    continue
                source = self._test_of(old)
                if not source.exists() or source in moves:
                    continue
                head, _, stem = new.rpartition(".")
                folder = self._test_folder(head)
                names = [f"test_{stem}.py", source.name, f"test_{stem}_{source.stem.removeprefix('test_')}.py"]
                if len([o for o in olds if self._test_of(o).exists()]) > 1:
                    names = [source.name, f"test_{stem}_{source.stem.removeprefix('test_')}.py"]
                for name in names:
                    target = folder / name
                    if target not in taken and (not target.exists() or target == source):
                        moves[source] = target
                        taken.add(target)
                        break
        return moves

    def _test_folder(self, package: str) -> Path:
        head, _, rest = package.partition(".")
        base = self.root / "tests" / "unit"
        if head == "gslcosim_services":
            base = base / "services"
        return base / rest.replace(".", "/") if rest else base

    def _test_of(self, module: str) -> Path:
        head, _, stem = module.rpartition(".")
        return self._test_folder(head) / f"test_{stem}.py"

    def _package_moves(self) -> dict[str, str]:
        moves = {}
        for module, path in self.old_modules.items():
            if path.name == "__init__.py":
                moves[module] = self.new_of[module]
        return moves

    def _move_data_files(self) -> None:
        for old, new in self._package_moves().items():
            if old == new or old.startswith("gslcosim_agents"):
                continue
            folder = self.old_modules[old].parent
            if not folder.exists():
                continue
            for path in sorted(folder.rglob("*")):
                if (
                    path.is_file()
                    and path.suffix != ".py"
                    and path.suffix != ".pyc"
                    and "__pycache__" not in path.parts
                ):
                    nearest = path.parent
                    if any((p / "__init__.py") in self.module_of_path for p in self._between(nearest, folder)):
                        continue  # belongs to a deeper package
                    head, _, rest = new.partition(".")
                    target = self.root / ROOTS[head] / rest.replace(".", "/") / path.relative_to(folder)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    path.rename(target)
            for path in sorted(folder.rglob("*.py")):
                # templates and other programs that are no modules
                if path not in self.module_of_path and path.exists() and self.is_orphan(path):
                    head, _, rest = new.partition(".")
                    target = self.root / ROOTS[head] / rest.replace(".", "/") / path.relative_to(folder)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    path.rename(target)

    def is_orphan(self, path: Path) -> bool:
        return not all(part.isidentifier() for part in path.relative_to(self.root).with_suffix("").parts)

    def _between(self, folder: Path, top: Path):
        while folder != top:
            yield folder
            folder = folder.parent

    def _text_files(self) -> None:
        listed = subprocess.run(
            ["git", "ls-files"], cwd=self.root, capture_output=True, text=True, check=True
        ).stdout.split("\n")
        unique: dict[str, set[str]] = defaultdict(set)
        for module, names in self.plan.names.items():
            for old, new in names.items():
                unique[old].add(new)
        defined_elsewhere = defaultdict(int)
        for module in self.old_modules:
            for name in self.defined[module]:
                defined_elsewhere[name] += 1
        safe = {
            o: next(iter(n))
            for o, n in unique.items()
            if len(n) == 1
            and defined_elsewhere[o] == len([m for m in self.plan.names if o in self.plan.names[m]])
            and ("_" in o.strip("_") or re.search("[a-z][A-Z]", o))
        }
        safe |= {o: n for o, n in self.plan.attributes.items() if "_" in o.strip("_")}
        for name in listed:
            path = self.root / name
            if (
                not name
                or not path.is_file()
                or path.suffix == ".py"
                or (path.suffix not in TEXT_SUFFIXES and path.name not in TEXT_FILES)
            ):
                continue
            if name.startswith("tests/renames/") or name == "CHANGELOG.md":
                continue
            try:
                text = path.read_text()
            except UnicodeDecodeError:
                continue
            new = self._map_dotted(text)
            new = _PATH.sub(lambda m: self._map_path(m.group()), new)
            if path.suffix in (".md", ".ipynb") and safe:
                new = re.sub(
                    r"`([^`\n]+)`",
                    lambda m: (
                        "`"
                        + re.sub(r"(?<![\w/-])[A-Za-z_]\w*", lambda w: safe.get(w.group(), w.group()), m.group(1))
                        + "`"
                    ),
                    new,
                )
            if new != text:
                path.write_text(new)

    # Each table of old names says where a module of the first release is now, and names that are called otherwise.
    def _old_names(self) -> None:
        folder = self.root / "gslcosim/base/old_names"
        if not (folder / "moved_modules.json").exists():
            return
        tables = [json.loads((folder / f"{name}.json").read_text()) for name in ("moved_modules", "renamed_in_place")]
        entries: dict[str, dict] = {**tables[1], **tables[0]}
        for module in self._modules_of_first_release():
            if module in self.old_modules:
                entries.setdefault(module, {"module": module})
        moved, in_place = {}, {}
        for old, entry in sorted(entries.items()):
            now = entry["module"]
            names = {name: self.new_name(now, known) for name, known in entry.get("names", {}).items()}
            for name, new in self.plan.names.get(now, {}).items():
                if not name.startswith("_") and name not in entry.get("names", {}).values():
                    names.setdefault(name, new)
            written: dict = {"module": self.new_of[now]}
            if names := {name: new for name, new in names.items() if name != new}:
                written["names"] = names
            stays = old in self.new_of.values()
            if not stays:
                moved[old] = written
            elif written != {"module": old}:
                in_place[old] = written
            if stays and old not in self.packages and any(other.startswith(f"{old}.") for other in entries):
                self.notes.append(f"old names: {old} is a module now, and had modules in it")
        for name, table in (("moved_modules", moved), ("renamed_in_place", in_place)):
            rows = [f"  {json.dumps(old)}: {json.dumps(entry, ensure_ascii=False)}" for old, entry in table.items()]
            (folder / f"{name}.json").write_text("{\n" + ",\n".join(rows) + "\n}\n")

    def _modules_of_first_release(self) -> list[str]:
        command = ["git", "ls-tree", "-r", "--name-only", FIRST_RELEASE, "gslcosim"]
        listed = subprocess.run(command, cwd=self.root, capture_output=True, text=True, check=True).stdout.split()
        parts = [Path(name).with_suffix("").parts for name in listed if name.endswith(".py")]
        return [".".join(p[:-1] if p[-1] == "__init__" else p) for p in parts if all(map(str.isidentifier, p))]

    def _packages(self, folder: Path) -> None:
        if folder.name == "agents":
            return
        for path in sorted(folder.rglob("*.py")):
            package = path.parent
            while package != folder:
                if (
                    not (package / "__init__.py").exists()
                    and package.name.isidentifier()
                    and not any(p.name == "templates" for p in package.parents)
                    and package.name != "templates"
                ):
                    dotted = ".".join(
                        (next(k for k, v in ROOTS.items() if v == folder.name), *package.relative_to(folder).parts)
                    )
                    (package / "__init__.py").write_text(
                        f'"""{self.plan.first_lines.get(dotted, package.name.replace("_", " ").capitalize() + ".")}"""\n'
                    )
                    self.notes.append(f"package: {dotted} is new")
                package = package.parent


def _join_pragmas(pragmas: list[str]) -> list[str]:
    codes: set[str] = set()
    others, reason = [], ""
    for pragma in dict.fromkeys(pragmas):
        if match := re.fullmatch(r"# ruff: noqa: ([A-Z0-9, ]+?)( - .*)?", pragma):
            codes.update(match.group(1).split(", "))
            reason = reason or match.group(2) or ""
        else:
            others.append(pragma)
    return [*others, f"# ruff: noqa: {', '.join(sorted(codes))}{reason}"] if codes else others


# An import that was local, of what is now in the same module, leaves a `pass` where it stood.
def drop_passes(text: str) -> str:
    if _OWN_IMPORT not in text:
        return text
    lines: list[str | None] = list(text.split("\n"))
    for node in ast.walk(ast.parse(text)):
        for part in ("body", "orelse", "finalbody"):
            body = getattr(node, part, None)
            if not isinstance(body, list):
                continue
            passes = [
                each for each in body if isinstance(each, ast.Pass) and _OWN_IMPORT in (lines[each.lineno - 1] or "")
            ]
            for each in passes if len(body) > len(passes) else passes[1:]:
                lines[each.lineno - 1] = None
                if each.lineno < len(lines) and lines[each.lineno] == "":
                    lines[each.lineno] = None
    return "\n".join(line for line in lines if line is not None)


def strongly_connected(graph: dict[str, set[str]]) -> list[set[str]]:
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []
    sys.setrecursionlimit(10000)

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            circle = set()
            while True:
                other = stack.pop()
                circle.add(other)
                if other == node:
                    break
            found.append(circle)

    for node in list(graph):
        if node not in index:
            visit(node)
    return found


def remove_empty(folder: Path) -> None:
    import shutil

    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and path.name == "__pycache__":
            shutil.rmtree(path)
        elif path.is_dir() and not any(path.iterdir()):
            path.rmdir()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("maps", nargs="+", type=Path)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--root", type=Path, default=Path.cwd())
    parser.add_argument("--missing", action="append", default=[], help="packages whose modules must all be in the map")
    parser.add_argument("--notes", action="store_true")
    options = parser.parse_args()
    problems: list[str] = []
    plan = load_plan(options.maps, problems)
    renamer = Renamer(options.root.resolve(), plan)
    renamer.problems += problems
    renamer.check()
    for package in options.missing:
        for module in renamer.old_modules:
            if (module == package or module.startswith(package + ".")) and module not in plan.modules:
                renamer.problems.append(f"modules: {module} is missing")
    if options.check:
        for path in [*renamer.old_modules.values()]:
            renamer.rewrite(path)
    elif not renamer.problems:
        renamer.run()
    if options.notes:
        print("\n".join(renamer.notes))
    print("\n".join(renamer.problems) or "no problems")
    olds = [m for m in plan.modules if m in renamer.old_modules]
    print(
        f"{len(olds)} modules of the map become {len({plan.modules[m] for m in olds})}; {sum(map(len, plan.names.values()))} names, {len(plan.attributes)} attributes, {len(plan.first_lines)} first lines; {len(renamer.notes)} notes (--notes)"
    )
    sys.exit(bool(renamer.problems))


if __name__ == "__main__":
    main()
