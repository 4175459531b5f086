"""Tables of a detector's errors: by visibility, cause, depth margin, size, crowding, direction and joint."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.reporting.tables import Table
from synth.detector.parts import kind_of
from synth.recognition.crops import NEAR, UNOBSTRUCTED
from synth.recognition.observations import DetectorObservations, JointsSeen, PeopleSeen

_MARGINS = (0.05, 0.15, 0.3, 1.0)
_SIZES = (150.0, 250.0, 400.0)
_CROWDING = (0.15, 0.3, 0.6)
_SHARES = (0.2, 0.4, 0.6, 0.8)
_CAUSES = {
    Visibility.VISIBLE: "visible",
    Visibility.HIDDEN_BY_SELF: "hidden by the own body",
    Visibility.HIDDEN_BY_PERSON: "hidden by another person",
    Visibility.HIDDEN_BY_OBJECT: "hidden by an object",
}
_COLUMNS = (
    ("joints", "near", f"Detected joints within {NEAR:.0%} of the height, %"),
    ("joints", "median", "Median error, % of the height"),
    ("joints", "confidence", "Mean confidence, %"),
    ("joints", "missed", "Joints missed, of people who were found, %"),
    ("joints", "inverted", "Joints on that of the other side, %"),
    ("people", "found", "People found, %"),
)
"""The tables, their columns, and their captions."""
_KINDS = np.array([kind_of(joint) for joint in BODY25.joints])


@dataclass(frozen=True)
class JointRow:
    """The joints of a group, for people that were found. Shares are from 0 to 1; None if no joint was detected.

    Attributes:
        heading, group: For example "cause" and "visible".
        joints: Number of joints.
        missed: Share of joints that were not detected.
        near: Share of detected joints with an error within 5 % of the height.
        median, p90: Median and 90 % quantile of the errors of detected joints, in heights.
        confidence: Mean confidence of detected joints.
        inverted: Share of detected joints at the position of the same joint of the other side.
    """

    heading: str
    group: str
    joints: int
    missed: float
    near: float | None
    median: float | None
    p90: float | None
    confidence: float | None
    inverted: float | None


@dataclass(frozen=True)
class PeopleRow:
    """The people of a group.

    Attributes:
        heading, group: For example "visible joints" and "80 % or more".
        people: Number of people.
        found: Share of people that were found.
    """

    heading: str
    group: str
    people: int
    found: float


def joint_rows(joints: JointsSeen) -> list[JointRow]:
    """Return the rows of joints. Visible and hidden joints are separate in rows by size, crowding, direction, kind."""
    visible = joints.cause == Visibility.VISIBLE
    groups = [("cause", name, joints.cause == cause) for cause, name in _CAUSES.items()]
    groups += [("margin of hidden joints", *each) for each in _ranges(joints.margin, _MARGINS, "m")]
    for state, chosen in (("visible", visible), ("hidden", ~visible)):
        kinds = [("joint", str(kind), _KINDS[joints.joint] == kind) for kind in dict.fromkeys(_KINDS)]
        groups += [(f"{name}, {state}", group, some & chosen) for name, group, some in (*_sorted(joints), *kinds)]
    return [_joint_row(heading, group, joints[some]) for heading, group, some in groups if some.any()]


def people_rows(people: PeopleSeen) -> list[PeopleRow]:
    """Return the rows of people. The rows by size, crowding and direction contain only people in plain sight."""
    plain = people.unobstructed >= UNOBSTRUCTED
    groups = [("visible joints", *each) for each in _ranges(people.visible, _SHARES)]
    groups.append(("in plain sight", "", plain))
    groups += [(f"{name}, in plain sight", group, some & plain) for name, group, some in _sorted(people)]
    return [
        PeopleRow(heading, group, int(some.sum()), float(people.found[some].mean()))
        for heading, group, some in groups
        if some.any()
    ]


def _sorted(seen: JointsSeen | PeopleSeen) -> list[tuple[str, str, np.ndarray]]:
    """Return headings and groups, with a mask of the members of each group."""
    found = [("size", *each) for each in _ranges(seen.size, _SIZES, "px")]
    found += [("crowding", *each) for each in _ranges(seen.crowding, _CROWDING, "heights")]
    return found + [("direction", group, seen.direction == group) for group in ("facing", "sideways", "away")]


def numbers(found: DetectorObservations) -> dict:
    """Return the tables of a detector for JSON."""
    return {
        "joints": [asdict(row) for row in joint_rows(found.joints)],
        "people": [asdict(row) for row in people_rows(found.people)],
        "pictures": found.pictures,
        "ghosts": found.ghosts,
        "duplicates": found.duplicates,
    }


def tables(studied: dict[str, dict]) -> list[Table]:
    """Return tables with one column per detector, from the results of `numbers`. Kinds of joints are left out.

    The first detector determines the rows.
    """
    names, made = list(studied), []
    for of, column, title in _COLUMNS:
        keyed = {name: {_name(row): row for row in studied[name][of]} for name in names}
        rows = [
            (key, str(row[of]), *(_percent(keyed[name].get(key, {}).get(column)) for name in names))
            for key, row in keyed[names[0]].items()
            if not row["heading"].startswith("joint")
        ]
        made.append(Table(title, (of, "number", *names), rows))
    counts = [
        (name, f"{100 * each['ghosts'] / each['pictures']:.1f}", f"{100 * each['duplicates'] / each['pictures']:.1f}")
        for name, each in studied.items()
    ]
    made.append(Table("In a hundred pictures", ("detector", "ghosts", "duplicates"), counts))
    return made


def _name(row: dict) -> str:
    return f"{row['heading']}: {row['group']}" if row["group"] else row["heading"]


def _ranges(values: np.ndarray, edges: Sequence[float], unit: str = "") -> list[tuple[str, np.ndarray]]:
    """Return the name of each range between edges, with a mask of the values in it."""
    ends = (0.0, *edges, np.inf)
    after = f" {unit}" if unit else ""
    found = []
    for low, high in pairwise(ends):
        name = f"{low:g} or more{after}" if high == np.inf else f"{low:g} to {high:g}{after}"
        with np.errstate(invalid="ignore"):
            found.append((name, (values >= low) & ((values < high) | (high == np.inf))))
    return found


def _joint_row(heading: str, group: str, some: JointsSeen) -> JointRow:
    error, score = some.error[~some.missed], some.score[~some.missed]
    known = len(error) > 0
    return JointRow(
        heading,
        group,
        len(some.error),
        float(some.missed.mean()),
        float((error < NEAR).mean()) if known else None,
        float(np.median(error)) if known else None,
        float(np.quantile(error, 0.9)) if known else None,
        float(score.mean()) if known else None,
        float(some.inverted[~some.missed].mean()) if known else None,
    )


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
