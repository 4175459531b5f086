"""The appearance of each person of a clip in each view: size, distance, direction, posture, visible joints."""

import json
from dataclasses import dataclass

import numpy as np

from dmae.data.clip import Clip
from dmae.data.conversion import convert
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.numerics.body import body_heading
from synth.scene.spec import SceneSpec

STATURE = 1.7
"""Height of a body if its clip does not state it, m."""
_FACING, _AWAY = np.radians(60), np.radians(120)
_BENT = np.radians(45)
_SEATED = 0.6
"""Height of the hips above the feet below which a person counts as seated, relative to the length of the leg."""
_INDEX = {joint: i for i, joint in enumerate(BODY25.joints)}


@dataclass(frozen=True)
class Sightings:
    """The P people of a clip in its V views, in F frames.

    Attributes:
        xy: (F, V, P, 25, 2) true joints of BODY25, px; NaN behind the camera.
        visibility: (F, V, P, 25) `Visibility`.
        depth_margin: (F, V, P, 25) distance in depth between a hidden joint and its occluder, m.
        height: (F, V, P) height that the body would have if it stood upright at its distance, px; NaN behind the
            camera.
        distance: (F, V, P) distance from the camera to the hips, m.
        turned: (F, V, P) angle between the direction to the camera and the direction that the body faces, rad, 0 to pi.
        bent: (F, P) True where the trunk leans by more than 45 degrees.
        seated: (F, P) True where the hips are as low as on a chair. This includes crouching.
    """

    xy: np.ndarray
    visibility: np.ndarray
    depth_margin: np.ndarray
    height: np.ndarray
    distance: np.ndarray
    turned: np.ndarray
    bent: np.ndarray
    seated: np.ndarray

    @property
    def visible(self) -> np.ndarray:
        """(F, V, P, 25) True for visible joints."""
        return self.visibility == Visibility.VISIBLE

    @property
    def unobstructed(self) -> np.ndarray:
        """(F, V, P, 25) True for joints that are visible or hidden only by the person's own body."""
        return self.visibility <= Visibility.HIDDEN_BY_SELF

    @property
    def direction(self) -> np.ndarray:
        """(F, V, P) text: direction of the body towards the camera, sideways, or away from it."""
        return np.select([self.turned < _FACING, self.turned > _AWAY], ["facing", "away"], "sideways")

    @property
    def posture(self) -> np.ndarray:
        """(F, P) text: upright, bent or seated."""
        return np.select([self.bent, self.seated], ["bent", "seated"], "upright")

    @property
    def crowding(self) -> np.ndarray:
        """(F, V, P) distance in the image from the hips of each person to the nearest other hips, in heights.

        It is inf for a person without others.
        """
        hips = self.xy[..., _INDEX["mid_hip"], :]
        apart = np.linalg.norm(hips[..., :, None, :] - hips[..., None, :, :], axis=-1)
        people = np.arange(apart.shape[-1])
        apart[..., people, people] = np.inf
        return np.where(np.isnan(apart), np.inf, apart).min(-1, initial=np.inf) / self.height


def sightings(clip: Clip) -> Sightings:
    """Return the appearance of the people of a clip in its views.

    Raises:
        ValueError: the clip has no truth, or no visibility labels.
    """
    if clip.truth is None or clip.occlusion is None or clip.occlusion.depth_margin is None:
        raise ValueError(f"clip {clip.id!r}: expected truth and labels of visibility, as synth generate makes them")
    columns = truth_columns(clip)
    xyz = convert(clip.truth, BODY25).xyz.astype(np.float64)
    rig = clip.true_rig or clip.rig
    xy, depth = rig.project(xyz)
    hips = xyz[:, :, _INDEX["mid_hip"]]
    depth = np.where(depth[..., _INDEX["mid_hip"]] > 0, depth[..., _INDEX["mid_hip"]], np.nan)
    focal = rig.focal
    sight = rig.centers[:, None] - hips[:, None]
    heading = body_heading(xyz, BODY25)[:, None]
    turned = np.abs(np.angle(np.exp(1j * (heading - np.arctan2(sight[..., 1], sight[..., 0])))))
    trunk = xyz[:, :, _INDEX["neck"]] - hips
    lean = np.arccos(np.clip(trunk[..., 2] / np.maximum(np.linalg.norm(trunk, axis=-1), 1e-6), -1, 1))
    return Sightings(
        xy=xy,
        visibility=clip.occlusion.visibility[..., columns],
        depth_margin=clip.occlusion.depth_margin[..., columns],
        height=statures(clip) * focal[:, None] / depth,
        distance=np.linalg.norm(sight, axis=-1),
        turned=turned,
        bent=lean > _BENT,
        seated=_hips_over_feet(xyz) < _SEATED,
    )


def truth_columns(clip: Clip) -> list[int]:
    """Return the indices of the joints of BODY25 in the truth of a clip."""
    joints = clip.truth.skeleton.joints
    prefix = "body25." if "body25.nose" in joints else ""
    return clip.truth.skeleton.index(*(prefix + joint for joint in BODY25.joints))


def scene_of(clip: Clip) -> SceneSpec | None:
    """Return the scene of a simulated clip; None for a recording."""
    spec = clip.provenance.get("spec")
    return None if spec is None else SceneSpec.from_json(json.dumps(spec))


def statures(clip: Clip) -> np.ndarray:
    """Return the heights (P,) of the bodies, m."""
    scene = scene_of(clip)
    people = clip.truth.xyz.shape[1]
    return np.full(people, STATURE) if scene is None else np.array([each.body.stature for each in scene.persons])


def _hips_over_feet(xyz: np.ndarray) -> np.ndarray:
    """Return the height (F, P) of the hips above the lower foot, relative to the length of the longer leg."""
    hip, knee, ankle = (xyz[:, :, BODY25.index(f"l_{part}", f"r_{part}")] for part in ("hip", "knee", "ankle"))
    leg = np.linalg.norm(hip - knee, axis=-1) + np.linalg.norm(knee - ankle, axis=-1)
    return (hip[..., 2].mean(-1) - ankle[..., 2].min(-1)) / np.maximum(leg.max(-1), 1e-6)
