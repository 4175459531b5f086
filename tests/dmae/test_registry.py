"""The registry that formats, completion methods, metrics, interactions and motion readers share."""

import math
import sys
from dataclasses import dataclass
from functools import partial

import pytest

from dmae.registry import Entry, Registry, _decorated, load_function, telling_errors

ANIMALS = '''
from zoo import animal


@animal("dog", legs=4)
def bark(times, *, loud=False):
    """Bark, then growl.

    More than once.
    """
    return ("loud " if loud else "") + times * "woof "


@animal(legs=2)
def sing():
    """Sing."""
'''
COMPUTED = '''
from zoo import animal

LEGS = 6


@animal(legs=LEGS)
def buzz():
    """Buzz."""
'''


@dataclass(frozen=True)
class Animal(Entry):
    legs: int


@pytest.fixture
def animal(tmp_path, monkeypatch):
    """A registry of a package with a module of animals."""
    (tmp_path / "zoo").mkdir()
    (tmp_path / "zoo" / "__init__.py").touch()
    (tmp_path / "zoo" / "animals.py").write_text(ANIMALS)
    (tmp_path / "farm.py").write_text('def moo():\n    """Moo."""\n')
    monkeypatch.syspath_prepend(tmp_path)
    import zoo

    zoo.animal = Registry("animal", Animal, "zoo", option="pet", plain=False)
    yield zoo.animal
    _decorated.cache_clear()
    for name in [name for name in sys.modules if name.split(".")[0] in ("zoo", "farm")]:
        del sys.modules[name]


def test_entries_are_read_from_the_source(animal):
    assert list(animal) == ["dog", "sing"]
    dog = animal["dog"]
    assert (dog.help, dog.options, dog.legs, dog.home) == ("Bark, then growl.", ("loud",), 4, "zoo.animals:bark")
    assert "zoo.animals" not in sys.modules
    assert dog.function(2, loud=True) == "loud woof woof "
    assert dog == animal._imported["zoo.animals:bark"]


def test_settings_that_are_no_literals_import_their_module(animal, tmp_path):
    (tmp_path / "zoo" / "insects.py").write_text(COMPUTED)
    assert animal["buzz"].legs == 6
    assert "zoo.insects" in sys.modules and "zoo.animals" not in sys.modules


def test_a_function_elsewhere_is_added_by_the_decorator(animal):
    @animal("cat", legs=4)
    def purr():
        """Purr."""

    assert animal.find("cat").function.__wrapped__ is purr
    assert list(animal) == ["cat", "dog", "sing"]


def test_a_name_is_taken_once(animal):
    with pytest.raises(ValueError, match=r"animal 'dog': there is one already, zoo\.animals:bark"):
        animal("dog", legs=4)(lambda: None)


def test_two_functions_of_one_name_are_refused(animal, tmp_path):
    (tmp_path / "zoo" / "wolves.py").write_text(ANIMALS)
    with pytest.raises(ValueError, match=r"animal 'dog': there are two, zoo\.animals:bark and zoo\.wolves:bark"):
        list(animal)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("dig", "no animal 'dig'; did you mean dog? There are dog, sing, and package.module:function names another"),
        ("xyz", "no animal 'xyz'; there are dog, sing, and package.module:function names another"),
        ("farm:bleat", "pet=farm:bleat: farm has no function 'bleat'; it has ['moo']"),
        ("farm:moo", "pet=farm:moo: expected a function under the decorator animal(...)"),
    ],
)
def test_names_that_are_not_found_are_answered(animal, name, message):
    with pytest.raises(ValueError) as error:
        animal.find(name)
    assert str(error.value) == message


def test_a_function_itself_is_answered_with_its_name(animal):
    with pytest.raises(TypeError, match=r"expected a name, or .*; its name is 'math:floor'"):
        animal.find(math.floor)


def test_a_function_is_named_by_a_module_that_has_it(animal, tmp_path):
    (tmp_path / "farm.py").write_text("from zoo.animals import bark")
    assert animal.find("zoo.animals:bark") == animal.find("farm:bark") == animal["dog"]


@pytest.mark.usefixtures("animal")
def test_any_callable_is_an_entry_where_no_settings_are_needed(tmp_path):
    (tmp_path / "farm.py").write_text("from functools import partial\nshout = partial(lambda a, b: a + b, 1)")
    found = Registry("sound", Entry, "zoo", option="pet").find("farm:shout")
    assert (found.name, found.function(2)) == ("farm:shout", 3)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return {}['l_elbow']", r"farm:shout: KeyError: 'l_elbow' \(farm\.py, line 6\)"),
        ("return np.zeros(3) + np.zeros(4)", r"farm:shout: ValueError: operands could .* \(farm\.py, line 6\)"),
        ("return deep()", r"farm:shout: OSError: gone \(farm\.py, line 3\)"),
        ("return None", r"farm:shout: expected it to return str, found NoneType"),
    ],
)
def test_an_error_of_a_function_elsewhere_names_it_and_the_line(animal, tmp_path, body, message):
    (tmp_path / "farm.py").write_text(
        f"import numpy as np\ndef deep():\n    raise OSError('gone')\ndef shout():\n    if True:\n        {body}\n"
    )
    found = Registry("sound", Entry, "zoo", option="pet", returns=("str",)).find("farm:shout")
    with pytest.raises(ValueError, match=f"^{message}$"):
        found.function()


def test_an_error_of_what_is_no_plain_function_names_it():
    made: dict = {}
    exec("def look(key):\n    return {}[key]", made)
    with pytest.raises(ValueError, match=r"^None:look: KeyError: 'x' \("):
        telling_errors(made["look"])("x")
    with pytest.raises(ValueError, match=r"^functools:partial: KeyError: 'x' \("):
        telling_errors(partial(made["look"], "x"))()


def test_errors_that_tell_of_bugs_stay_what_they_are(animal):
    @animal("cat", legs=4)
    def purr():
        """Purr."""
        return None + 1

    with pytest.raises(TypeError, match="unsupported operand"):
        animal.find("cat").function()


@pytest.mark.usefixtures("animal")
def test_without_an_option_only_names_are_found():
    with pytest.raises(ValueError, match=r"no bird 'farm:moo'; there are dog, sing$"):
        Registry("animal", Animal, "zoo", kind="bird").find("farm:moo")


def test_a_function_of_other_arguments_is_refused_before_it_is_called():
    shapes = Registry("shape", Entry, option="form", arguments=("x", "y"))
    assert shapes.find("math:copysign").function(2, -1) == -2
    with pytest.raises(ValueError, match="form=math:floor: expected a function of x and y"):
        shapes.find("math:floor")


def test_a_function_is_imported_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "my_plugin.py").write_text("def double(x):\n    return 2 * x\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert load_function("option", "my_plugin:double")(3) == 6
    sys.modules.pop("my_plugin")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import no_such_package", "ModuleNotFoundError: No module named 'no_such_package'"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("def other():\n    pass", r"broken_plugin has no function 'double'; it has \['other'\]"),
    ],
)
def test_a_module_that_fails_is_one_error_that_names_the_option(tmp_path, monkeypatch, text, message):
    (tmp_path / "broken_plugin.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    sys.modules.pop("broken_plugin", None)
    with pytest.raises(ValueError, match=f"option=broken_plugin:double: .*{message}"):
        load_function("option", "broken_plugin:double")
    sys.modules.pop("broken_plugin", None)
