"""JSON with lists of numbers on one line is the same JSON."""

import json

from hypothesis import given
from hypothesis import strategies as st

from dmae.data.json_values import json_text

scalars = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()
values = st.recursive(scalars, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)


@given(values)
def test_nothing_is_changed(value):
    assert json.loads(json_text(value)) == json.loads(json.dumps(value))


def test_numbers_share_a_line_and_texts_are_left_as_they_are():
    assert json_text({"a": [1, None, -2.5e-7]}) == '{\n "a": [1, null, -2.5e-07]\n}'
    assert json.loads(json_text(["[\n 1\n]"])) == ["[\n 1\n]"]
