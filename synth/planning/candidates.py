"""Candidate cameras: each place combined with each useful direction and lens."""

from dataclasses import dataclass

import numpy as np

from dmae.data.cameras import CameraRig
from synth.planning.config import LensConfig
from synth.planning.mounts import CameraPlaces
from synth.rigs.camera_geometry import look_at, pose
from synth.rigs.coverage import Stage, find_faults

_TARGET_HEIGHT = 1.0
"""Height of the points that cameras are aimed at, m."""
_AIM_OFFSET = 0.5
"""Distance from the middle of the other points that cameras are aimed at, as a share of the radius of people."""


@dataclass(frozen=True)
class CandidateCameras:
    """Cameras that a rig can be chosen from.

    Attributes:
        rig: C cameras. Cameras at the same place differ in direction or lens.
        place: (C,) index of the place of each camera.
        kind: (C,) "wall", "ceiling", "tripod", or "given" for existing cameras.
        view_deg: (C,) horizontal field of view, degrees.
    """

    rig: CameraRig
    place: np.ndarray
    kind: np.ndarray
    view_deg: np.ndarray

    def __len__(self) -> int:
        return len(self.rig)

    @property
    def pan_deg(self) -> np.ndarray:
        """(C,) direction of the optical axis about the vertical, degrees from +x towards +y."""
        x, y, _ = self.rig.cam_from_world[:, 2, :3].T
        return np.degrees(np.arctan2(y, x))

    @property
    def tilt_deg(self) -> np.ndarray:
        """(C,) angle of the optical axis above the horizontal, degrees; below 0 for cameras that look down."""
        return np.degrees(np.arcsin(np.clip(self.rig.cam_from_world[:, 2, 2], -1, 1)))


def aimed_cameras(
    places: CameraPlaces, lens: LensConfig, middle: np.ndarray, radius: float, stage: Stage, *, steepest: float = 90.0
) -> CandidateCameras:
    """Return cameras at all places, aimed at the middle of the people's area and at four points around it.

    Places from which no people can be seen are left out.

    Args:
        places: K places.
        lens: The available lenses.
        middle: (2,) middle of the people's area, m.
        radius: Radius of the people's area, m.
        stage: The people's area around the origin, for the checks of `synth.rigs.coverage`.
        steepest: Greatest angle at which cameras look down, degrees.

    Raises:
        ValueError: people can be seen from fewer than two places.
    """
    centers, aims, place, angles = [], [], [], []
    for number, at in enumerate(places.at):
        ahead = np.append(middle, _TARGET_HEIGHT) - at
        ahead = ahead[:2] / max(np.linalg.norm(ahead[:2]), 1e-9)
        aside = np.array([-ahead[1], ahead[0]])
        for offset in (0 * ahead, ahead, -ahead, aside, -aside):
            for angle in lens.view_deg:
                centers.append(at)
                aims.append([*(middle + _AIM_OFFSET * radius * offset), _TARGET_HEIGHT])
                place.append(number)
                angles.append(angle)
    centers, place = np.array(centers), np.array(place)
    rig = CameraRig(
        tuple(f"c{number}" for number in range(len(centers))),
        np.stack([lens.matrix(angle) for angle in angles]),
        np.zeros((len(centers), 5)),
        pose(look_at(centers, np.array(aims)), centers),
        np.tile(lens.size, (len(centers), 1)),
    )
    found = CandidateCameras(rig, place, places.kind[place], np.array(angles))
    faulty = set(find_faults(rig, stage))
    kept = [c for c in range(len(rig)) if c not in faulty and found.tilt_deg[c] >= -steepest]
    if len(set(place[kept].tolist())) < 2:
        raise ValueError(
            "people can be seen from fewer than two of the places for cameras; widen mount.area or the heights of "
            "mount.walls and mount.tripods, lens.view_deg, or mount.steepest_deg"
        )
    return CandidateCameras(rig[kept], place[kept], found.kind[kept], found.view_deg[kept])


def given_cameras(rig: CameraRig) -> CandidateCameras:
    """Return the cameras of an existing rig as candidates."""
    view = 2 * np.degrees(np.arctan(rig.size[:, 0] / 2 / rig.K[:, 0, 0]))
    return CandidateCameras(rig, np.arange(len(rig)), np.full(len(rig), "given"), view)
