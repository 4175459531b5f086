"""4D association: limbs of all views and the people of the frame before, joined clique by clique.

Zhang, An, Yu, Li, Li and Liu, 4D Association Graph for Realtime Multi-person Motion Capture Using Multiple Video
Cameras, CVPR 2020. Rules and constants are those with which the released code runs on Shelf
(github.com/zhangyux15/4d_association). Published on Shelf: 97.6 % PCP (99.0, 96.2, 97.6 by actor).

What differs:
- There are no part affinity fields. A limb edge joins two joints of one detected 2D pose, with the geometric mean of
  their confidences; joints of different 2D poses of a view have none, so that a 2D pose is cut but never regrouped.
- A track must fit all views of a clique, where the code looks at the last view alone.
- Joints are triangulated by least squares, as by the code's simpler updater. Its body of fixed bones, which also places
  what nobody sees, is left out: a joint in fewer than two views is absent.

n detections of all views of a frame in a row, V views, T people of the frame before.
"""

import heapq
from itertools import combinations, count

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import joint_depths
from dmae.numerics.filling import are_stills
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.systems.common import Frame, as_poses, frames_of, meet

_EPIPOLAR_M, _TRACKING_M = 0.15, 0.2
"""m; distances between two rays, and between a ray and a joint of the frame before, at which edges end."""
_EPIPOLAR, _TRACKING, _LIMB, _VIEWS, _ROOT = 2.0, 2.0, 1.0, 2.0, 0.5
"""Weights in the score of a clique: of its edges, of its number of views, and of how near the root its bone is."""
_FEW_VIEWS = 1.5  # Number of views at which the score for their number is 0.2; it rises to 1
_LEAST_ASSIGNED, _LEAST_JOINTS = 5, 5
"""Fewest detected joints of a new person in all views, and fewest joints in space of any person."""
_MOST_CLIQUES, _MOST_CAMERAS = 2000, 12
"""Of one bone: beyond this number the best are kept, which Shelf never reaches. And of a rig, as all subsets of cameras
are listed."""
_NONE = -1


@capture_method("4d_association", paper="Zhang et al. 2020")
def capture_by_4d_association(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Join limbs between views and with the people of the frame before, the most certain clique of limbs first."""
    if len(clip.rig) > _MOST_CAMERAS:
        raise ValueError(
            f"clip {clip.id!r}: method=4d_association lists all subsets of cameras, and takes at most {_MOST_CAMERAS}; "
            f"found {len(clip.rig)}. Choose some of them"
        )
    skeleton, centers = clip.detections.skeleton, clip.rig.centers
    if not skeleton.bones:
        raise ValueError(f"clip {clip.id!r}: method=4d_association joins limbs; {skeleton.name!r} has none")
    before: dict[int, np.ndarray] = {}
    births, tracks, found, views = count(), [], [], []
    for frame in frames_of(clip, config):
        people = _associate(frame, centers, skeleton, list(before.values()))
        now = {}
        for position, assigned in sorted(people.items()):
            xyz, seen = _triangulate(frame, centers, assigned)
            if np.isfinite(xyz[:, 0]).sum() >= _LEAST_JOINTS:
                now[list(before)[position] if position < len(before) else next(births)] = xyz, seen
        tracks.append(np.array(list(now), int))
        found.append(np.array([xyz for xyz, _ in now.values()]).reshape(-1, len(skeleton), 3))
        views.append(np.array([seen for _, seen in now.values()], int).reshape(-1, len(skeleton)))
        # Of stills nobody is known from the frame before.
        before = {} if are_stills(clip.fps) else {track: xyz for track, (xyz, _) in now.items()}
    return as_poses(clip, tracks, found, views)


def _triangulate(frame: Frame, centers: np.ndarray, assigned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (J, 3), m, nearest to rays of assigned detections (J, V), NaN below two views; and views."""
    joints = np.arange(len(assigned))[:, None]
    seen = assigned != _NONE
    rays, score = frame.rays[assigned, joints], frame.score[assigned, joints]
    across = np.eye(3) - rays[..., None] * rays[..., None, :]
    across = np.where(seen[..., None, None], across * np.maximum(score, 1e-3)[..., None, None], 0)
    views, xyz = seen.sum(1), np.full((len(assigned), 3), np.nan)
    known = views > 1
    matrix = across.sum(1)[known]
    xyz[known] = np.linalg.solve(matrix, (across @ centers[..., None]).sum(1)[known])[..., 0]
    return xyz, np.where(known, views, 0)


def _associate(
    frame: Frame, centers: np.ndarray, skeleton: Skeleton, before: list[np.ndarray]
) -> dict[int, np.ndarray]:
    """Return the detections (J, V) of each person in each view, or `_NONE`; the first T persons are `before`."""
    graph = _Graph(frame, centers, skeleton, before)
    cliques = []
    for bone in range(len(skeleton.bones)):
        cliques += graph.cliques(bone)
    heapq.heapify(cliques)
    people = _People(graph, len(centers), len(before))
    while cliques:
        _, bone, members, person = heapq.heappop(cliques)
        for rest, wanted in people.join(bone, members, person):
            if rest:
                heapq.heappush(cliques, (-graph.score(bone, rest, wanted), bone, rest, wanted))
    return people.large_enough()


class _Graph:
    """Edges between joints of views and of the frame before, each 0 to 1, or -1 where there can be none.

    `view` of each detection; `epipolar` is [J][n][n], `tracking` [J][T][n], `limb` [bone][n]; `root` [bone] is 1 at the
    root of the body, 0 at its last bones.
    """

    def __init__(self, frame: Frame, centers: np.ndarray, skeleton: Skeleton, before: list[np.ndarray]):
        self.bones, self.view = skeleton.bones, frame.view.tolist()
        self.of_view = [np.flatnonzero(frame.view == view).tolist() for view in range(len(centers))]
        size, joints = len(frame.view), len(skeleton)
        epipolar, tracking = np.full((joints, size, size), -1.0), np.full((joints, len(before), size), -1.0)
        for a, b in combinations(filter(None, self.of_view), 2):
            first, second = (index.ravel() for index in np.meshgrid(a, b, indexing="ij"))
            gap = meet(frame, centers, first, second)[1].T.reshape(joints, len(a), len(b))
            edges = _shared_out(np.where(gap < _EPIPOLAR_M, 1 - gap / _EPIPOLAR_M, -1.0))
            epipolar[np.ix_(range(joints), a, b)] = edges
            epipolar[np.ix_(range(joints), b, a)] = edges.swapaxes(1, 2)
        if before:
            away = np.array(before)[:, None] - centers[frame.view][:, None]
            gap = np.linalg.norm(np.cross(away, frame.rays), axis=-1).transpose(2, 0, 1)
            near = np.where(gap < _TRACKING_M, 1 - gap / _TRACKING_M, -1.0)
            for own in self.of_view:
                tracking[:, :, own] = _shared_out(near[:, :, own])
        a, b = np.array(self.bones).T
        self.epipolar, self.tracking = epipolar.tolist(), tracking.tolist()
        self.limb = np.nan_to_num(np.sqrt(frame.score[:, a] * frame.score[:, b]), nan=-1.0).T.tolist()
        depths = joint_depths(skeleton)
        deepest = max(max(depths) - 1, 1)
        self.root = [1 - (depths[parent] / deepest) ** 4 for parent, _ in self.bones]

    def cliques(self, bone: int) -> list[tuple]:
        """Return all cliques of a bone as (-score, bone, detections of different views, person before or `_NONE`)."""
        (a, b), limb = self.bones[bone], self.limb[bone]
        epipolar_a, epipolar_b = self.epipolar[a], self.epipolar[b]
        found: list[tuple[int, ...]] = [()]
        for own in self.of_view:
            if len(found) > _MOST_CLIQUES:
                found = [(), *sorted(found[1:], key=lambda members: -self.score(bone, members, _NONE))[:_MOST_CLIQUES]]
            found += [
                (*members, each)
                for members in found
                for each in own
                if limb[each] >= 0 and all(epipolar_a[m][each] > 0 and epipolar_b[m][each] > 0 for m in members)
            ]
        tracks = list(zip(self.tracking[a], self.tracking[b], strict=True))
        return [
            (-self.score(bone, members, person), bone, members, person)
            for members in found[1:]
            for person in (
                _NONE,
                *(p for p, (at, to) in enumerate(tracks) if all(at[m] > 0 and to[m] > 0 for m in members)),
            )
        ]

    def score(self, bone: int, members: tuple[int, ...], person: int) -> float:
        """Return the score of a clique: the weighted mean of its edges, of its number of views, and of its bone."""
        a, b = self.bones[bone]
        pairs = [(self.epipolar[a][i][j] + self.epipolar[b][i][j]) / 2 for i, j in combinations(members, 2)]
        epipolar = sum(pairs) / len(pairs) if pairs else 1.0
        tracking = 0.0
        if person != _NONE:
            tracking = (
                sum(self.tracking[a][person][m] + self.tracking[b][person][m] for m in members) / 2 / len(members)
            )
        limb = sum(self.limb[bone][m] for m in members) / len(members)
        views = 1 - np.exp(-((len(members) / _FEW_VIEWS) ** 2) / 2)
        total = _EPIPOLAR * epipolar + _TRACKING * tracking + _LIMB * limb + _VIEWS * views + _ROOT * self.root[bone]
        return float(total / (_EPIPOLAR + _TRACKING + _LIMB + _VIEWS + _ROOT))


def _shared_out(edges: np.ndarray) -> np.ndarray:
    """Return edges (J, A, B) divided by the sum of their row, then of their column, where it is above 1."""
    edges = edges / np.maximum(edges.sum(2, keepdims=True), 1)
    return edges / np.maximum(edges.sum(1, keepdims=True), 1)


class _People:
    """People that grow by cliques: `joints[person][joint][view]` is a detection, `owner[joint][n]` its person."""

    def __init__(self, graph: _Graph, views: int, before: int):
        self.graph, self.views, self.before = graph, views, before
        self.count = len(graph.epipolar)
        self.owner = [[_NONE] * len(graph.view) for _ in range(self.count)]
        self.joints = {person: self._nobody() for person in range(before)}
        self.next = before
        self.bones_at = [[bone for bone in graph.bones if joint in bone] for joint in range(self.count)]

    def _nobody(self) -> list[list[int]]:
        return [[_NONE] * self.views for _ in range(self.count)]

    def large_enough(self) -> dict[int, np.ndarray]:
        """Return (J, V) of the people before, and of new ones with enough detected joints."""
        found = {person: np.array(joints) for person, joints in self.joints.items()}
        least = {person: 0 if person < self.before else _LEAST_ASSIGNED for person in found}
        return {person: joints for person, joints in found.items() if (joints >= 0).sum() >= least[person]}

    def fits(self, joint: int, detection: int, person: int) -> int:
        """Return how many edges join a detected joint to a person, or -1 if it contradicts that person."""
        view, joints, edges = self.graph.view[detection], self.joints[person], 0
        if joints[joint][view] not in (_NONE, detection):
            return -1
        for a, b in self.bones_at[joint]:
            neighbour = joints[b if a == joint else a][view]
            if neighbour != _NONE:
                # Limb edges exist within one detected 2D pose only.
                if neighbour != detection:
                    return -1
                edges += 1
        for other, each in enumerate(joints[joint]):
            if other != view and each != _NONE:
                if self.graph.epipolar[joint][detection][each] <= 0:
                    return -1
                edges += 1
        return edges

    def take(self, joint: int, detection: int, person: int) -> None:
        self.joints[person][joint][self.graph.view[detection]] = detection
        self.owner[joint][detection] = person

    def join(self, bone: int, members: tuple[int, ...], person: int) -> list[tuple[tuple[int, ...], int]]:
        """Assign a clique to people; return what is left of it as cliques of detections and a person before."""
        ends = self.graph.bones[bone]
        owners = [{each: self.owner[end][each] for each in members} for end in ends]
        if person != _NONE:
            return self._join_before(ends, members, person)
        votes = [_votes(each.values()) for each in owners]
        if not votes[0] and not votes[1]:
            return self._join_new(ends, members)
        if not votes[0] or not votes[1]:
            return self._join_end(ends, members, votes)
        if votes[0][0][0] == votes[1][0][0]:
            return self._join_same(ends, members, votes)
        return self._join_two(ends, members, votes)

    def _join_before(self, ends, members, person):
        if any(self.fits(end, each, person) < 0 for each in members for end in ends):
            return [(members, _NONE)]
        rest = []
        for each in members:
            if all(self.owner[end][each] in (_NONE, person) for end in ends):
                for end in ends:
                    self.take(end, each, person)
            else:
                rest.append(each)
        return [(tuple(rest), _NONE)]

    def _join_new(self, ends, members):
        """No detection is assigned. A limb of one view joins the person it has most edges with, others are a person."""
        best = None
        if len(members) == 1:
            edges = {p: [self.fits(end, members[0], p) for end in ends] for p in self.joints}
            fitting = {p: sum(each) for p, each in edges.items() if min(each) >= 0 and sum(each) > 0}
            best = max(fitting, key=fitting.__getitem__, default=None)
        if best is None:
            best, self.next = self.next, self.next + 1
            self.joints[best] = self._nobody()
        for each in members:
            for end in ends:
                self.take(end, each, best)
        return []

    def _join_end(self, ends, members, votes):
        """One end is assigned: the other end joins its person."""
        known = 0 if votes[0] else 1
        (person, most), others = votes[known][0], votes[known][1:]
        rest = []
        for each in members:
            if self.owner[ends[known]][each] == person:
                if self.fits(ends[1 - known], each, person) >= 0:
                    self.take(ends[1 - known], each, person)
            elif (
                self.owner[ends[known]][each] == _NONE
                and most >= 2
                and not others
                and all(self.fits(end, each, person) >= 0 for end in ends)
            ):
                for end in ends:
                    self.take(end, each, person)
            else:
                rest.append(each)
        return [(tuple(rest), _NONE)] if len(rest) < len(members) else []

    def _join_same(self, ends, members, votes):
        """Both ends are of one person: further views of the limb join it."""
        person, rest = votes[0][0][0], []
        agreed = len(votes[0]) == len(votes[1]) == 1
        for each in members:
            owned = [self.owner[end][each] for end in ends]
            if owned == [person, person]:
                continue
            free = [owner in (_NONE, person) for owner in owned]
            fitting = all(self.fits(end, each, person) >= 0 for end in ends)
            if fitting and all(free) and (agreed or person in owned):
                for end in ends:
                    self.take(end, each, person)
            else:
                rest.append(each)
        return [(tuple(rest), _NONE)] if len(rest) < len(members) else []

    def _join_two(self, ends, members, votes):
        """The ends are of different people: these become one, or the clique is cut where they contradict."""
        master, slave = sorted((votes[0][0][0], votes[1][0][0]))
        conflict = [self._contradict(master, slave, view) for view in range(self.views)]
        if slave >= self.before and not any(conflict) and self._meet(master, slave):
            for joint, row in enumerate(self.joints.pop(slave)):
                for each in row:
                    if each != _NONE:
                        self.take(joint, each, master)
            return [(tuple(m for m in members if any(self.owner[end][m] != master for end in ends)), _NONE)]
        parts = [tuple(m for m in members if conflict[self.graph.view[m]] == kind) for kind in (False, True)]
        if all(parts):
            return [(part, _NONE) for part in parts]
        return [((each,), _NONE) for each in members] if len(members) > 1 else []

    def _contradict(self, master: int, slave: int, view: int) -> bool:
        one, other = ([row[view] for row in self.joints[person]] for person in (master, slave))
        if slave < self.before or any(
            _NONE not in pair and pair[0] != pair[1] for pair in zip(one, other, strict=True)
        ):
            return True
        tracking = self.graph.tracking
        if master < self.before and any(
            each != _NONE and tracking[joint][master][each] <= 0 for joint, each in enumerate(other)
        ):
            return True
        crossed = [(one[a], other[b]) for a, b in self.graph.bones] + [(other[a], one[b]) for a, b in self.graph.bones]
        return any(_NONE not in pair and pair[0] != pair[1] for pair in crossed)

    def _meet(self, master: int, slave: int) -> bool:
        """Whether the rays of two people meet in all joints that both have in different views."""
        return all(
            self.graph.epipolar[joint][one][other] > 0
            for joint in range(self.count)
            for a, one in enumerate(self.joints[master][joint])
            for b, other in enumerate(self.joints[slave][joint])
            if a != b and _NONE not in (one, other)
        )


def _votes(owners) -> list[tuple[int, int]]:
    """Return people and their number of votes, the most first."""
    known = [owner for owner in owners if owner != _NONE]
    return sorted(((p, known.count(p)) for p in dict.fromkeys(known)), key=lambda vote: -vote[1])
