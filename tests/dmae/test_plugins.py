import sys

import pytest

from dmae.plugins import load_function


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
