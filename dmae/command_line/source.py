"""Read constants, enums and dataclasses from the source of modules, without importing them.

Help has to be fast, and the modules that hold configurations load torch, MuJoCo or SciPy.
"""

import ast
import enum
import importlib
import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

_OWN = ("dmae", "synth")
_ENUMS = {"Enum", "StrEnum", "IntEnum"}


class Unreadable(Exception):
    """The value of an expression cannot be found out from the source."""


class Opaque:
    """Placeholder for a function or a foreign object."""

    def __getattr__(self, name: str) -> "Opaque":
        return Opaque()

    def __call__(self, *args, **kwargs):
        raise Unreadable


@dataclass(frozen=True)
class DataclassSource:
    """A dataclass as its module writes it."""

    module: "Module"
    node: ast.ClassDef

    @cached_property
    def documentation(self) -> str:
        """The docstring up to its section of attributes."""
        return (ast.get_docstring(self.node) or "").partition("\nAttributes:")[0].strip()

    def fields(self) -> Iterator[tuple[ast.AnnAssign, str, "Module"]]:
        """Each field, what is written about it, and the module that its names are to be looked up in."""
        for base in self.node.bases:
            inherited = self.module.lookup(base.id) if isinstance(base, ast.Name) else None
            if isinstance(inherited, DataclassSource):
                yield from inherited.fields()
        listed = _attributes(ast.get_docstring(self.node) or "")
        for statement, following in zip(self.node.body, [*self.node.body[1:], None], strict=True):
            if isinstance(statement, ast.AnnAssign):
                yield statement, _string(following) or listed.get(statement.target.id, ""), self.module


class Module:
    """The names that a module defines, each evaluated when it is asked for."""

    def __init__(self, name: str):
        self.name = name
        self.tree = ast.parse(_path(name).read_text())
        self.found: dict[str, ast.stmt] = {}
        for statement in self.tree.body:
            for each in _bound(statement):
                self.found[each] = statement

    def lookup(self, name: str):
        """The value of a name: a constant, an enum, a `DataclassSource`, or an `Opaque` stand-in.

        Raises:
            Unreadable: the value is computed in a way that the source does not tell.
        """
        statement = self.found.get(name)
        match statement:
            case None | ast.FunctionDef():
                return Opaque()
            case ast.ImportFrom():
                (alias,) = (alias for alias in statement.names if name in (alias.asname, alias.name))
                return self._imported(statement.module, alias.name)
            case ast.Import():
                return Opaque()
            case ast.ClassDef():
                return self._class(statement)
            case ast.Assign(value=ast.Call(func=ast.Name(id="Registry"))):
                # A registry reads its entries from source files, so that its module imports quickly.
                return getattr(importlib.import_module(self.name), name)
            case _:
                return self.evaluate(statement.value)

    def evaluate(self, node: ast.expr):
        """The value of an expression. Raises Unreadable."""
        names = {part.id for part in ast.walk(node) if isinstance(part, ast.Name) and part.id in self.found}
        values = {name: self._known(name) for name in names}
        try:
            value = eval(compile(ast.Expression(node), self.name, "eval"), values)
        except Exception as error:
            raise Unreadable(f"{self.name}: {ast.unparse(node)}: {error}") from None
        if isinstance(value, Opaque):
            raise Unreadable(f"{self.name}: {ast.unparse(node)}")
        return value

    def _known(self, name: str):
        """Return the value of a name, or `Opaque` where it is computed: for a table, its keys may be enough."""
        try:
            return self.lookup(name)
        except Unreadable:
            return Opaque()

    def documentation(self) -> str:
        return ast.get_docstring(self.tree) or ""

    def _imported(self, module: str, name: str):
        if module.partition(".")[0] in _OWN:
            inner = f"{module}.{name}"
            return Opaque() if _exists(inner) else load(module)._known(name)
        if module in ("enum", "math"):
            return getattr(importlib.import_module(module), name)
        return Opaque()

    def _class(self, node: ast.ClassDef):
        if _ENUMS & {base.id for base in node.bases if isinstance(base, ast.Name)}:
            names = [each for statement in node.body if isinstance(statement, ast.Assign) for each in _bound(statement)]
            members = enum.Enum(node.name, names)
            members.__doc__ = ast.get_docstring(node)
            return members
        if any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list):
            return DataclassSource(self, node)
        return Opaque()


@cache
def load(name: str) -> Module:
    """The source of a module of this project, by its dotted name."""
    return Module(name)


def _path(name: str) -> Path:
    top, *parts = name.split(".")
    base = Path(importlib.util.find_spec(top).submodule_search_locations[0]).joinpath(*parts)
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


def _exists(name: str) -> bool:
    return _path(name).is_file()


def _bound(statement: ast.stmt | None) -> list[str]:
    """Names that a statement binds."""
    match statement:
        case ast.Assign(targets=targets):
            parts = [part for target in targets for part in ast.walk(target)]
            return [part.id for part in parts if isinstance(part, ast.Name)]
        case ast.AnnAssign(target=ast.Name(id=name), value=value) if value is not None:
            return [name]
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return [name]
        case ast.ImportFrom(names=names) | ast.Import(names=names):
            return [alias.asname or alias.name.partition(".")[0] for alias in names]
    return []


def _string(statement: ast.stmt | None) -> str:
    match statement:
        case ast.Expr(value=ast.Constant(value=str(text))):
            return " ".join(text.split())
    return ""


def _attributes(docstring: str) -> dict[str, str]:
    """What a docstring's section of attributes says of each; `a, b: text` says it of both."""
    found, names = {}, []
    for line in docstring.partition("\nAttributes:\n")[2].splitlines():
        indent = len(line) - len(line.lstrip())
        if indent == 4 and ": " in line:
            heads, _, text = line.strip().partition(": ")
            names = [name.strip() for name in heads.split(",")]
            found |= dict.fromkeys(names, text)
        elif indent > 4:
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
        elif line.strip():
            break
    return found
