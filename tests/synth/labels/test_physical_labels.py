"""Physical labels on disk: saved labels are loaded, and errors name damaged ones."""

from dataclasses import fields, replace

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from synth.labels.physical_labels import (
    FILE,
    KINDS,
    PhysicalLabels,
    check_kinds,
    physical_labels,
    save_physical_labels,
)
from tests.support.physical_labels import made_labels


@pytest.mark.parametrize("kinds", [KINDS, ("forces",), ("contacts", "surface")])
def test_labels_are_loaded_as_they_were_saved(tmp_path, kinds):
    whole = made_labels(3, 2, 2)
    labels = PhysicalLabels(**{kind: getattr(whole, kind) for kind in kinds})
    save_physical_labels(labels, tmp_path)
    found = physical_labels(tmp_path)
    assert found.kinds == kinds
    for kind in kinds:
        for field in fields(getattr(whole, kind)):
            expected, value = (getattr(getattr(each, kind), field.name) for each in (whole, found))
            np.testing.assert_array_equal(value, expected)
            assert getattr(value, "dtype", str) == getattr(expected, "dtype", str)


def test_wrenches_are_of_all_contacts_of_a_person_but_with_themselves():
    labels = made_labels(2, 1, 1).contacts
    centre = np.zeros((2, 3))
    np.testing.assert_allclose(labels.wrench(0, centre)[:, :3], [(1, 2, 700)] * 2)
    np.testing.assert_allclose(labels.wrench(0, centre)[:, 3:], np.cross(labels.point, labels.force), rtol=1e-5)
    own = replace(labels, between=np.array([(1, 2)] * 2, np.int16))
    assert not own.wrench(0, centre).any()
    swapped = replace(labels, between=labels.between[:, ::-1])
    np.testing.assert_allclose(swapped.wrench(0, centre), -labels.wrench(0, centre))


def test_wrong_kinds_files_and_shapes_are_refused(tmp_path):
    for wrong in ([], ["contact"]):
        with pytest.raises(ValueError, match="expected a list of contacts, forces, surface"):
            check_kinds(wrong)
    with pytest.raises(FileNotFoundError, match="synth label data="):
        physical_labels(tmp_path)
    save_physical_labels(made_labels(2, 1, 1), tmp_path)
    save_file(load_file(tmp_path / FILE), tmp_path / FILE)
    with pytest.raises(ValueError, match=f"{FILE}: expected physical labels of format 2"):
        physical_labels(tmp_path)
    labels = made_labels(2, 1, 1)
    with pytest.raises(ValueError, match=r"BodyForces\.residual: expected shape \(2, 1, 2, 3\)"):
        replace(labels.forces, residual=labels.forces.residual[:1])
    with pytest.raises(ValueError, match="expected between to count 3 names"):
        replace(labels.contacts, between=labels.contacts.between + 2)
    with pytest.raises(ValueError, match=r"SurfaceLabels\.hidden_by: expected shape"):
        replace(labels.surface, hidden_by=labels.surface.hidden_by[:, :0])
