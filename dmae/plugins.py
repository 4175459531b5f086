"""Functions of users' own, named `package.module:function` in an option."""

import importlib
import inspect
import sys
from collections.abc import Callable
from pathlib import Path


def load_function(option: str, name: str, example: str = "my_module:my_function") -> Callable:
    """Import a function, `package.module:function`, from the current folder or from the installed packages.

    Raises ValueError, with the option and an example of it, if there is none, or its module cannot be imported.
    """
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise ValueError(f"{option}={name}: expected package.module:function, as in {option}={example}")
    if str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))
    try:
        module = importlib.import_module(module_name)
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
        known = [
            key
            for key, value in functions.items()
            if not key.startswith("_") and value.__module__.partition(".")[0] not in foreign
        ]
        raise ValueError(f"{option}={name}: {module_name} has no function {function_name!r}; it has {known}")
    return function
