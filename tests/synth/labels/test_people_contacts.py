import numpy as np
import pytest

from synth.labels.forces import owners


def test_owners_are_numbers_of_persons_and_none_for_objects():
    names = ["person2/l_foot", "floor", "personal_desk", "person10/r_hand"]
    np.testing.assert_array_equal(owners(names), [2, -1, -1, 10])


@pytest.mark.parametrize("name", ["person1e18/l_foot", "personNaN/l_foot", "person/l_foot", "person-1/l_foot"])
def test_names_of_persons_without_a_number_are_refused(name):
    with pytest.raises(ValueError, match=r"contacts: name .* expected person<number>/<segment>"):
        owners([name])
