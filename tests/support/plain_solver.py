"""A robust triangulation as short as one can be, from numpy and OpenCV alone, and ways to break it."""

from itertools import combinations

import cv2
import numpy as np

from dmae.regression.pack import cases
from dmae.regression.verdicts import check

EVERY = {case.name for case in cases()}
OUTLIERS = {"outliers-1-of-5", "outliers-2-of-8"}

_NEAR = 30.0
"""px; a view agrees with a point that reprojects so near."""


def plain(*, K, dist, cam_from_world, size, xy, confidence, bug=""):
    """All pairs of views propose points, the one that most views agree with is solved again from those."""
    # OpenCV ignores the skew of K, so it is given normalised points.
    axes, centre = K[:, :2, :2], K[:, :2, 2]
    xy = np.einsum("vij,nvj->nvi", np.linalg.inv(axes), xy - centre)
    xy = np.stack([cv2.undistortPoints(xy[:, v, None], np.eye(3), dist[v])[:, 0] for v in range(len(K))], 1)
    xy = np.einsum("vij,nvj->nvi", axes, xy) + centre
    seen = np.isfinite(xy[..., 0]) & np.isfinite(confidence)
    xy, weight = np.where(seen[..., None], xy, 0), np.where(seen, confidence, 0)
    R, t = cam_from_world[:, :3, :3], cam_from_world[:, :3, 3]
    middle = -np.einsum("vji,vj->vi", R, t).mean(0)
    local = np.concatenate([R, (R @ middle + t)[..., None]], -1)
    P = K @ (cam_from_world[:, :3] if bug == "float32 normal equations" else local)
    if bug == "unweighted outliers":
        best = seen.astype(float)
    else:
        proposals = []
        for pair in map(list, combinations(range(len(K)), 2)):
            agree = agreement(solve(P[pair], xy[:, pair], weight[:, pair]), P, xy, seen, bug)
            proposals.append(np.where(agree & agree[:, pair].all(-1, keepdims=True), weight, 0))
        best = np.stack(proposals)[np.sum(proposals, -1).argmax(0), np.arange(len(xy))]
    xyz = solve(P, xy, best, bug)
    good = (agreement(xyz, P, xy, seen, bug) & (best > 0)).sum(-1) >= 2
    if bug == "unweighted outliers":
        good = agreement(xyz, P, xy, seen, near=np.inf).sum(-1) >= 2
    if bug in ("wrong homogeneous divide", "float32 normal equations"):
        good = seen.sum(-1) >= 2
    return np.where(good[:, None], xyz + (0 if bug == "float32 normal equations" else middle), np.nan)


def solve(P, xy, weight, bug=""):
    """(n, 3) linear solutions of weighted views."""
    rows = (weight[..., None, None] * (xy[..., None] * P[:, None, 2] - P[:, :2])).reshape(len(xy), -1, 4)
    if bug == "float32 normal equations":
        rows = rows.astype(np.float32)
        homogeneous = np.linalg.eigh(rows.swapaxes(1, 2) @ rows)[1][..., 0].astype(float)
    else:
        homogeneous = np.linalg.svd(rows)[2][:, -1]
    if bug == "wrong homogeneous divide":
        return homogeneous[:, :3] / np.linalg.norm(homogeneous[:, :3], axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return homogeneous[:, :3] / homogeneous[:, 3:]


def agreement(xyz, P, xy, seen, bug="", near=_NEAR):
    """(n, V) True for the views that see a point near where it is, in front of them."""
    homogeneous = np.einsum("vij,nj->nvi", P, np.concatenate([xyz, np.ones_like(xyz[:, :1])], -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(homogeneous[..., :2] / homogeneous[..., 2:] - xy, axis=-1)
    return seen & (off < near) & ((homogeneous[..., 2] > 0) | (bug == "behind-camera points"))


def broken(solver) -> set[str]:
    """Names of the cases that a solver fails."""
    return {verdict.case.name for verdict in check(solver) if not verdict.passed}
