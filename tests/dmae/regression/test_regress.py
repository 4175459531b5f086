"""The regression pack accepts correct solvers, refuses wrong ones, and names their fault."""

import re
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import fields
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from dmae.regression import solvers
from dmae.regression.pack import Case, cases, unpack
from dmae.regression.verdicts import PURPOSES, REASONS, assert_passes, check, check_case, oracle
from tests.support.clips import full_clip
from tests.support.commands import dmae
from tests.support.plain_solver import EVERY, OUTLIERS, broken, plain

sys.path.insert(0, str(Path(__file__).parents[3] / "docs/tools"))

import regression_pack


def case_named(name) -> Case:
    return next(case for case in cases() if case.name == name)


def test_our_own_solver_passes_in_seconds():
    start = time.perf_counter()
    for verdict in check(solvers.ours):
        assert verdict.passed, str(verdict)
    assert time.perf_counter() - start < 30


def test_a_plain_robust_solver_passes():
    for verdict in check(plain):
        assert verdict.passed, str(verdict)


def test_examples_break_where_they_say():
    assert broken(solvers.dlt) == OUTLIERS | {"far-world", "behind", "doubted", "crowd-5"}
    assert {"clean", "distorted-8", "views-2", "far-world"} <= EVERY - broken(solvers.opencv)
    assert OUTLIERS | {"behind", "views-3", "views-12", "doubted"} <= broken(solvers.opencv)


def raises(**given):
    raise RuntimeError("no licence")


def leaves(**given):
    sys.exit(0)


def hangs(**given):
    while True:
        with suppress(Exception):
            time.sleep(0.01)


@pytest.mark.parametrize(
    ("solver", "said"),
    [
        (raises, "raised RuntimeError: no licence (test_regress.py, line "),
        (leaves, "raised SystemExit: 0"),
        (hangs, "did not return within 0.2 s"),
        (lambda **given: solvers.ours(**given)[1:], "returned shape (149, 3), expected (150, 3) of xy (150, 5, 2)"),
        (lambda **given: None, "returned None, expected (n, 3) points"),
        (lambda **given: "points", "raised ValueError: could not convert"),
        (lambda **given: solvers.ours(**given) / 0.0, "points are infinite, expected NaN"),
        (lambda **given: np.zeros((150, 3)), "mm where 0.10 mm is allowed"),
        (lambda **given: np.full((150, 3), np.nan), "refused 100% where 0% is allowed"),
        (lambda **given: solvers.ours(**given).astype(np.float16), "mm where 0.10 mm is allowed"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_failures_of_a_solver_are_described(solver, said):
    verdict = check_case(solver, case_named("clean"), seconds=0.2)
    assert not verdict.passed
    assert said in str(verdict)
    assert str(verdict).startswith("clean: ")
    with pytest.raises(AssertionError, match="clean: "):
        assert_passes(lambda **given: None, case_named("clean"))


def test_a_solver_cannot_spoil_the_pack():
    def spoils(**given):
        found = solvers.ours(**given)
        for array in given.values():
            array[:] = 0
        return found

    assert not broken(spoils)
    assert not broken(spoils)


def test_refusing_all_that_is_hard_is_no_way_to_pass():
    """A tenth refused, the worst by the truth: errors shrink, and the refusals tell."""

    def picks(case, **given):
        xyz = solvers.ours(**given)
        error = np.linalg.norm(xyz - case.xyz, axis=-1)
        xyz[error > np.nanquantile(error, 0.9)] = np.nan
        return xyz

    for name in ("noisy", "outliers-1-of-5", "views-2"):
        case = case_named(name)
        assert check_case(partial(picks, case), case).broken == ("refused",)


def test_cases_can_be_left_out_but_not_misspelt():
    assert {verdict.case.name for verdict in check(plain, skip=["behind", "crowd-3"])} == EVERY - {"behind", "crowd-3"}
    with pytest.raises(ValueError, match="no case 'beneath'; there are clean, "):
        check(plain, skip=["beneath"])


def test_every_case_and_bound_is_explained():
    assert set(PURPOSES) == EVERY
    for verdict in check(solvers.ours):
        assert set(verdict.bounds) <= set(verdict.measured) == set(REASONS)


def test_the_pack_is_what_its_recipe_makes():
    for made, frozen in zip(regression_pack.seeded_cases(), cases(), strict=False):
        assert made.name == frozen.name
        for field in fields(Case)[1:]:
            np.testing.assert_allclose(
                getattr(made, field.name), getattr(frozen, field.name), rtol=1e-7, atol=1e-4, err_msg=made.name
            )


def test_a_crowd_is_sorted_into_persons():
    """Exact detections in shuffled order, a tenth of them missing: each lands on its own person's joints."""
    clip = full_clip(frames=3, views=5)
    whole, part = regression_pack.crowd_cases(clip)
    assert whole.xyz.shape == (1 * 2 * 14, 3)
    assert part.xy.shape == (28, 3, 2)
    np.testing.assert_array_equal(part.xy, whole.xy[:, [0, 2, 4]])
    expected, _ = clip.rig.project(whole.xyz)
    missing = np.isnan(whole.xy)
    assert 0 < missing.mean() < 0.3
    np.testing.assert_allclose(np.where(missing, expected, whole.xy), expected, atol=1e-3)
    np.testing.assert_array_equal(whole.usable, ~missing[..., 0])


@pytest.mark.parametrize("name", ["views-2", "views-12", "noisy", "short-baseline", "outliers-2-of-8"])
def test_the_oracle_attains_the_cramer_rao_bound(name):
    """Mahalanobis distances follow chi^2 of three degrees: mean 3, standard error of n of them sqrt(6 / n)."""
    case = case_named(name)
    xyz, cov = oracle(case)
    off = xyz - case.xyz
    distance = np.einsum("ni,nij,nj->n", off, np.linalg.inv(cov), off)
    assert abs(distance.mean() - 3) < 4 * np.sqrt(6 / len(off))


def test_a_damaged_pack_is_refused(monkeypatch, tmp_path):
    from dmae.regression import pack

    data = bytearray(pack.FILE.read_bytes())
    assert len(unpack(bytes(data))) == len(EVERY)
    data[len(data) // 2] ^= 1
    (tmp_path / "pack.npz").write_bytes(data)
    monkeypatch.setattr(pack, "FILE", tmp_path / "pack.npz")
    with pytest.raises(ValueError, match=r"pack.npz: does not match its checksum"):
        cases.__wrapped__()


def test_behind_and_absent_hold_what_they_say():
    behind, absent = case_named("behind"), case_named("absent")
    assert behind.unknowable.sum() == behind.due.sum() == 75
    assert np.isfinite(behind.xy).all()
    views = np.isfinite(absent.xy[..., 0]).sum(-1)
    assert {0, 1, 2, 3} <= set(views.tolist())
    np.testing.assert_array_equal(absent.unknowable, views < 2)


MINE = """
import numpy as np
from dmae.regression.solvers import ours

def mine(*, confidence, **given):
    return ours(confidence=confidence, **given)

def flipped(**given):
    return mine(**given) * (1, 1, -1)

def old(K, xy, confidence):
    return xy
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Somebody else's project."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "theirs").mkdir()
    (folder / "theirs/tri.py").write_text(MINE)
    (folder / "theirs/torn.py").write_text("import nowhere_to_be_found")
    (folder / "test_theirs.py").write_text(
        "from theirs.tri import flipped, mine\n"
        "def test_mine(check_triangulation):\n    check_triangulation(mine)\n"
        "def test_flipped(check_triangulation):\n    check_triangulation(flipped)\n"
        "def test_case(triangulation_case):\n    assert triangulation_case.xy.shape[2] == 2\n"
    )
    return folder


def test_a_project_checks_its_own_solver(project):
    done = dmae(project, "regress", "solver=theirs.tri:mine", "skip=[crowd-3]")
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith(f"{len(EVERY) - 1} of {len(EVERY) - 1} cases passed, 1 skipped\n")
    assert "FAIL" not in done.stdout
    assert {path.name for path in project.iterdir()} <= {"theirs", "test_theirs.py"}


def test_a_broken_bound_is_status_1_and_a_page_says_why(project, tmp_path):
    page = tmp_path / "page/report.html"
    done = dmae(project, "regress", "solver=theirs.tri:flipped", f"report={page}")
    assert done.returncode == 1
    assert "clean: worst" in done.stdout
    assert f"0 of {len(EVERY)} cases passed" in done.stdout
    text = page.read_text()
    HTMLParser().feed(text)
    assert PURPOSES["clean"] in text
    assert "Reasons of the bounds" in text


@pytest.mark.parametrize(
    ("solver", "said"),
    [
        ("theirs.tri", "solver=theirs.tri: expected package.module:function, as in solver=dmae."),
        ("their.tri:mine", "solver=their.tri:mine: cannot import their.tri: ModuleNotFoundError: No module"),
        ("theirs.torn:mine", "No module named 'nowhere_to_be_found'"),
        ("theirs.tri:main", "theirs.tri has no function 'main'; it has ['ours', 'mine', 'flipped', 'old']"),
        ("theirs.tri:old", "unexpected keyword argument 'dist'; expected a function of the keywords K, dist,"),
    ],
)
def test_a_solver_that_is_not_there_is_one_clear_error(project, monkeypatch, solver, said):
    monkeypatch.chdir(project)
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(ValueError, match=re.escape(said)):
        check(solver)


@pytest.mark.parametrize("solver", [5, np.zeros(3), lambda K, xy: xy])
def test_python_refuses_what_is_no_solver_rather_than_failing_every_case(solver):
    with pytest.raises(ValueError, match=r"solver=.*expected a function of the keywords K, dist, cam_from_world"):
        check(solver)


def test_what_is_wrong_in_every_case_is_said_once(project):
    (project / "theirs" / "lazy.py").write_text("def solve(**arrays):\n    arrays['xy'].mean()\n")
    done = dmae(project, "regress", "solver=theirs.lazy:solve")
    assert done.returncode == 1 and done.stderr == ""
    first, last = done.stdout.strip().splitlines()
    assert first == "theirs.lazy:solve: every case: returned None, expected (n, 3) points"
    assert last == f"0 of {len(EVERY)} cases passed"


def test_a_list_of_verdicts_is_short_enough_to_read():
    verdicts = check("dmae.regression.solvers:dlt", sorted(EVERY - {"clean", "skewed"}))
    assert repr(verdicts[0]) == "<clean: ok>" and len(repr(verdicts)) < 300


def test_help_describes_the_arrays(project):
    text = dmae(project, "regress", "--help").stdout
    assert "def solver(*, K, dist, cam_from_world, size, xy, confidence)" in text


def test_the_fixture_is_one_test_for_each_case(project):
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "dmae.regression.pytest_plugin",
        "-p",
        "no:cacheprovider",
        "--tb=short",
    ]
    done = subprocess.run([*command, str(project)], cwd=project, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert f"{len(EVERY)} failed, {2 * len(EVERY)} passed" in done.stdout
    assert "test_flipped[outliers-1-of-5]" in done.stdout


def test_the_plugin_loads_no_numerics():
    code = "import sys, dmae.regression.pytest_plugin; print('numpy' in sys.modules, 'cv2' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_the_scale_of_confidence_does_not_matter():
    def halved(*, confidence, **given):
        return plain(confidence=confidence / 2, **given)

    assert not broken(halved)


@pytest.mark.parametrize("seconds", [0, -1, np.nan])
def test_a_time_limit_that_limits_nothing_is_refused(seconds):
    with pytest.raises(ValueError, match="expected a time limit above 0"):
        check(lambda **_: None, seconds=seconds)
