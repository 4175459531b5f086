"""Registries: functions of one kind by name, each under a decorator in a file of its own.

    reader = Registry("reader", RecordingReader, __package__, option="data")

    @reader("lizard", signs=[["lizard.json"]])
    def read_lizard(path: Path, *, fps: float | None = None) -> Clip:
        '''Recording of the Lizard tracker.'''

Names, help and settings of the functions in a registry's packages are read from the source: `--help` lists them in
tenths of a second, and their modules, with SciPy, Numba, torch and MuJoCo, take 2 to 5 seconds to import. Names of
files cannot stand for them, as one file holds several functions, and a list elsewhere would be a second place to edit.
A function is imported on first use. Functions elsewhere are registered when their module is imported, and an option
takes any as `package.module:function` (`load_function`).
"""

import ast
import hashlib
import importlib.util
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, cached_property, wraps
from importlib import import_module
from pathlib import Path
from traceback import walk_tb
from typing import Generic, TypeVar

from dmae.nearest import unknown

E = TypeVar("E", bound="Entry")

_PACKAGES = ("dmae", "synth")
"""Functions of all others are the user's."""


@dataclass(frozen=True)
class Entry:
    """A registered function. The fields that a subclass adds are the settings that its decorator takes."""

    name: str  # As users type it
    help: str  # First line of the docstring
    options: tuple[str, ...]  # Names of the keyword-only arguments
    home: str  # `module:function`

    @cached_property
    def function(self) -> Callable:
        """The function, imported on first use."""
        module, _, name = self.home.partition(":")
        return getattr(import_module(module), name)


class Registry(Mapping[str, E], Generic[E]):
    """Functions of one kind by name, in alphabetical order.

    Args:
        decorator: Name of the registry in the modules that use it as a decorator.
        entry: Class of the entries; settings without a default are required.
        packages: Packages with the modules to search. A module is imported to list its functions only if a setting of
            one is not a literal.
        kind: What the functions are, for messages; by default the name of the decorator.
        option: Option that takes a name or `package.module:function`; by default only names are taken.
        plain: Whether `package.module:function` may be without the decorator, and so without settings.
        arguments: What such a function has to take.
        returns: Names of classes, one of which a function from outside of the packages has to return; by default
            whoever calls it checks.
    """

    def __init__(
        self,
        decorator: str,
        entry: type[E],
        *packages: str,
        kind: str = "",
        option: str = "",
        plain: bool = True,
        arguments: tuple[str, ...] = (),
        returns: tuple[str, ...] = (),
    ):
        self.decorator, self.kind, self.option = decorator, kind or decorator.replace("_", " "), option
        self._entry, self._packages, self._plain, self._arguments = entry, packages, plain, arguments
        self._returns = returns
        self._added: dict[str, E] = {}
        self._imported: dict[str, E] = {}

    def __call__(self, name: str | None = None, **settings) -> Callable[[Callable], Callable]:
        """Register the decorated function, by default under its name, with settings: fields of the entry.

        Raises ValueError if the name is taken, or the function has no docstring.
        """

        def register(function: Callable) -> Callable:
            key, home = name or function.__name__, _home(function)
            searched = function.__module__.rpartition(".")[0] in self._packages
            if not searched and key in self and self[key].home != home:
                raise ValueError(f"{self.kind} {key!r}: there is one already, {self[key].home}")
            entry = self._describe(function, key, self._help(function.__doc__, key), home, settings)
            (self._imported if searched else self._added)[home if searched else key] = entry
            return function

        return register

    def __iter__(self) -> Iterator[str]:
        return iter(sorted({*self._declared, *self._added}))

    def __len__(self) -> int:
        return len({*self._declared, *self._added})

    def __getitem__(self, name: str) -> E:
        return self._added[name] if name in self._added else self._declared[name]

    def find(self, name: str) -> E:
        """Return the entry of a name, or of `package.module:function`; ValueError, with the nearest name, if none."""
        self.check(name)
        if name in self:
            return self[name]
        function = load_function(self.option, name)
        known = next((entry for entry in self.values() if entry.home == _home(function)), None)
        if known is None and not self._plain:
            raise ValueError(f"{self.option}={name}: expected a function under the decorator {self.decorator}(...)")
        if known is None and self._arguments and not takes(function, *self._arguments):
            raise ValueError(f"{self.option}={name}: expected a function of {' and '.join(self._arguments)}")
        return known or self._describe(function, name, f"The function {name}.", name, {})

    def check(self, name: str, *others: str) -> None:
        """Raise ValueError, with the nearest name, if `name` is not in the registry, one of `others`, or a function.

        A function itself is a TypeError: configurations hold names.
        """
        if not isinstance(name, str):
            found = f"the function itself; its name is {_home(name)!r}" if callable(name) else repr(name)
            raise TypeError(f"{self.kind}: expected a name, or 'package.module:function' as text, found {found}")
        known = [*others, *self]
        if name not in known and not (self.option and ":" in name):
            another = ", and package.module:function names another" if self.option else ""
            raise ValueError(f"{unknown(self.kind, name, known)}{another}")

    @cached_property
    def _declared(self) -> dict[str, E]:
        """The functions in the modules of the packages, from their source."""
        found = {}
        functions = [each for package in self._packages for each in _decorated(package)]
        for _, module, function, call in (each for each in functions if each[0] == self.decorator):
            home = f"{module}:{function.name}"
            try:
                settings = {str(each.arg): ast.literal_eval(each.value) for each in call.keywords}
            except ValueError:  # not a literal: import the module to get the value
                import_module(module)
                entry = self._imported[home]
            else:
                name = ast.literal_eval(call.args[0]) if call.args else function.name
                options = tuple(argument.arg for argument in function.args.kwonlyargs)
                entry = self._entry(name, self._help(ast.get_docstring(function), name), options, home, **settings)
            if entry.name in found:
                raise ValueError(f"{self.kind} {entry.name!r}: there are two, {found[entry.name].home} and {home}")
            found[entry.name] = entry
        return found

    def _describe(self, function: Callable, name: str, help: str, home: str, settings: dict) -> E:
        parameters = inspect.signature(function).parameters.values()
        options = tuple(each.name for each in parameters if each.kind == inspect.Parameter.KEYWORD_ONLY)
        entry = self._entry(name, help, options, home, **settings)
        entry.__dict__["function"] = from_outside(function, self._returns)
        return entry

    def _help(self, docstring: str | None, name: str) -> str:
        if not docstring or not docstring.strip():
            raise ValueError(f"{self.kind} {name!r}: expected a docstring; its first line is the help")
        return docstring.strip().splitlines()[0]


@cache
def _decorated(package: str) -> list[tuple[str, str, ast.FunctionDef, ast.Call]]:
    """The functions of a package's modules whose decorator takes arguments: decorator, module, function, its call."""
    spec = importlib.util.find_spec(package)
    assert spec is not None and spec.submodule_search_locations is not None, package
    folder = Path(spec.submodule_search_locations[0])
    return [
        (each.func.id, f"{package}.{file.stem}", function, each)
        for file in sorted(folder.glob("*.py"))
        for function in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(function, ast.FunctionDef)
        for each in function.decorator_list
        if isinstance(each, ast.Call) and isinstance(each.func, ast.Name)
    ]


def _home(function: Callable) -> str:
    return f"{function.__module__}:{getattr(function, '__qualname__', type(function).__qualname__)}"


def _package(function: Callable) -> str:
    """Return the name of a function's package, "None" for those made by `exec` and some in C."""
    return str(function.__module__).partition(".")[0]


def takes(function: Callable, *arguments: str, **named: object) -> bool:
    """Return whether a function can be called with these arguments in their order, and these by their names."""
    try:
        inspect.signature(function).bind(*arguments, **named)
    except TypeError:
        return False
    except ValueError:
        pass  # compiled functions may have no signature
    return True


_SHOWN = 20
"""Number of functions of a module that a message lists, the most similar ones first if there are more."""


def load_function(option: str, name: str, example: str = "my_module:my_function") -> Callable:
    """Import a function, `package.module:function`, from the current folder or from the installed packages.

    Raises ValueError, with the option and an example of it, if there is none, or its module cannot be imported.
    """
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise ValueError(f"{option}={name}: expected package.module:function, as in {option}={example}")
    _look_here()
    try:
        module = import_module(module_name)
    # Any error that the import of the module raises, SystemExit included, is reported in one line.
    except (Exception, SystemExit) as error:
        raise ValueError(
            f"{option}={name}: cannot import {module_name}: {type(error).__name__}: {error} (looked in {Path.cwd()} "
            "and among the installed packages; expected package.module:function)"
        ) from error
    function = getattr(module, function_name, None)
    if not callable(function):
        functions = {key: value for key, value in vars(module).items() if inspect.isfunction(value)}
        # List functions that the module imports as well, except those of the standard library.
        foreign = sys.stdlib_module_names - {module_name}
        known = [key for key, value in functions.items() if not key.startswith("_") and _package(value) not in foreign]
        if len(known) > _SHOWN:
            known = [*get_close_matches(function_name, known, _SHOWN, 0), "..."]
        raise ValueError(f"{option}={name}: {module_name} has no function {function_name!r}; it has {known}")
    return function


class OutsideError(ValueError):
    """An error of a function that the user wrote: which one, what it raised, and in which line."""


def telling_errors(function: Callable, returns: tuple[str, ...] = ()) -> Callable:
    """Return a function whose errors say that they are its own, and not of options or files that were given.

    Commands print ValueError, KeyError and OSError in one line. Those that the function raises, or that the package
    raises because of what the function asked for, become an `OutsideError`, unless they are of this package's kinds.
    It is one as well if the function returns an object of none of the classes called `returns`. Functions of this
    package are returned as they are.
    """
    if _package(function) in _PACKAGES:
        return function
    name = _home(function)

    @wraps(function)
    def named(*args, **kwargs):
        try:
            found = function(*args, **kwargs)
        except (ValueError, KeyError, OSError) as error:
            if type(error).__module__.partition(".")[0] in _PACKAGES:
                raise
            raise OutsideError(f"{name}: {raised_in(error, function)}") from error
        if returns and not {each.__name__ for each in type(found).__mro__} & {*returns}:
            raise OutsideError(f"{name}: expected it to return {' or '.join(returns)}, found {type(found).__name__}")
        return found

    return named


from_outside = cache(telling_errors)
"""The same function for the same function. What is made anew for each clip, as a closure, is not kept."""


def raised_in(error: BaseException, function: Callable) -> str:
    """Return an error's type and text, with the last line of the function's package that led to it, if there is one."""
    package = _package(function)
    frames = [(each.f_globals.get("__name__"), each.f_code, line) for each, line in walk_tb(error.__traceback__)]
    *_, (_, code, line) = [each for each in frames if str(each[0]).partition(".")[0] == package] or frames
    return f"{type(error).__name__}: {str(error).strip()} ({Path(code.co_filename).name}, line {line})"


def source_hash(name: str) -> str | None:
    """Return a hash of the module of `package.module:function`; None for other names, or if there is no such module."""
    module, colon, _ = name.partition(":")
    if not colon:
        return None
    _look_here()
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
    if spec is None or spec.origin is None or not spec.has_location:
        return None
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()


def _look_here() -> None:
    """Let modules of the current folder be imported."""
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
