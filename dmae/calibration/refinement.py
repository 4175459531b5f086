"""Refinement: calibrate the cameras of a recording again, by the people in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmae.calibration.bundle_adjustment import (
    CENTRE,
    FOCAL,
    K1,
    OFFSET,
    ROTATION,
    Adjusted,
    Calibration,
    Freedom,
    ImageTracks,
    Observations,
    Q,
    adjust,
    covariance_of_cameras,
)
from dmae.calibration.config import ALL, AUTO, RefineConfig
from dmae.calibration.examination import SHORTEST_S, Examination, Kind, examine
from dmae.calibration.matching import initial_rig, match_tracks
from dmae.calibration.world import Floor, find_floor, place_like, place_rig, place_world, upright_world
from dmae.data.array_fields import short_repr
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.numerics.filling import are_stills
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

_ROUNDS = 3  # Number of rounds. Each round captures people with the cameras of the previous round.
_STEPS = 5  # Steps of the bodies whose errors are compared, the same before and after
_PRIOR = ((ROTATION, np.radians(3)), (CENTRE, 0.3), (FOCAL, 0.1), (K1, 0.3), (OFFSET, 0.5))
"""Standard deviations of the expected differences: rad, m, relative, k1, s."""


@dataclass(frozen=True)
class CameraChange:
    """The changes that refinement made to a camera."""

    camera: str  # Its name
    refined: bool  # Whether it was free to change
    moved_cm: float  # Distance between its centres before and after, in the world before
    turned_deg: float  # Angle between its directions
    focal: float  # Focal length after, relative to before
    k1: float  # k1 after
    late_frames: float  # Frames by which it started late, as `data.offsets`
    drift_frames_a_minute: float  # Growth of `late_frames`, frames per minute
    error_cm: float | None  # Standard error of its centre, root mean square over the axes
    error_deg: float | None  # The same for its direction
    error_frames: float | None  # Standard error of `late_frames`, if it was refined
    # residual_before, residual_after: Median reprojection error, px
    residual_before: float | None
    residual_after: float | None


@dataclass(frozen=True)
class Refined:
    """A refined calibration."""

    rig: CameraRig  # The cameras
    # offset, drift: (V,) s and s/s, as in `Calibration`
    offset: np.ndarray
    drift: np.ndarray
    # (V, Q, Q) of the parameters of each camera (`dmae.calibration.bundle_adjustment`). It assumes the usual errors of
    # detectors: correlated over some tenths of a second, with a constant part at each joint of a person in a view. 0
    # for parameters that were not refined.
    covariance: np.ndarray
    changes: tuple[CameraChange, ...]  # The changes of each camera, in the original world
    floor: Floor | None = None  # The original height of the floor and tilt of the world, if the world was made level
    turned_deg: float | None = None  # Angle between the original and the new z, if the world was made level
    # Why no camera changed, if `cameras=[auto]` found none, or which cameras are not synchronised; otherwise None
    note: str | None = None

    __repr__ = short_repr


def refine(clip: Clip, config: RefineConfig | None = None) -> Refined:
    """Return cameras that fit the people's detections better, from a clip of two or more, roughly calibrated.

    Raises ValueError if there are too few cameras or people, or no camera has a name in the configuration.
    """
    config = config or RefineConfig()
    if len(clip.rig) < 2:
        raise ValueError(f"clip {clip.id!r}: calibrating needs at least 2 cameras, found {len(clip.rig)}")
    if are_stills(clip.fps):
        if config.offsets or config.drift:
            raise ValueError(f"clip {clip.id!r}: stills have no clock; leave out refine.offsets and refine.drift")
        # A row of people is another person in each still.
        config = replace(config, bones=False)
    if not config.known:
        clip = replace(clip, rig=initial_rig(clip))
        config = replace(config, known=True, cameras=[ALL], extrinsics=True, level=True)
    origin = calibration = Calibration.of(clip.rig)
    views, note, tracks = _named_views(clip.rig, config), None, None
    if views is None:
        calibration, views, note, tracks = _differing(clip)
    before = None
    for number in progress(range(_ROUNDS), "adjusting cameras"):
        if number or tracks is None:
            tracks = match_tracks(replace(clip, rig=calibration.rig))
        observations = Observations.of(tracks, config.bodies)
        if len(observations) < 20:
            raise ValueError(
                f"clip {clip.id!r}: {len(observations)} bodies (a person in a frame) are seen by two cameras; "
                "calibrating needs 20 or more: record people who walk about, or correct what `dmae doctor` finds"
            )
        before = before or adjust(observations, origin, iterations=_STEPS, tolerance=1e-4)
        freedom = Freedom.of(
            len(clip.rig), views, rotation=config.extrinsics, centre=config.extrinsics, focal=config.focal,
            k1=config.distortion, offset=config.offsets, drift=config.drift,
        )  # fmt: skip
        for parameter, deviation in _PRIOR:
            freedom.prior[:, parameter] = deviation
        adjusted = adjust(
            observations, calibration, freedom, bones=config.bones, offsets=not are_stills(clip.fps), tolerance=1e-6,
            iterations=30,
        )  # fmt: skip
        calibration = adjusted.calibration
        if config.extrinsics and len(views) == len(clip.rig):
            # Detections do not show where the world of the cameras is, nor how large it is.
            calibration = replace(calibration, rig=place_like(calibration.rig, origin.rig))
        if not views:
            break
    assert before is not None and tracks is not None
    covariance = covariance_of_cameras(observations, adjusted, freedom)
    after = adjust(observations, calibration, iterations=_STEPS, tolerance=1e-4)
    changes = _changes(origin, calibration, covariance, views, before, after, clip.fps)
    rig = place_world(calibration.rig, after.xyz, tracks.skeleton, config.stature, level=False)
    floor = turned = None
    if config.level:
        floor = find_floor(capture(replace(clip, rig=rig), CaptureConfig()), clip.fps)
        world = upright_world(floor)
        if world is not None and floor.up is not None and floor.height_m is not None:
            rig = place_rig(rig, world)
        else:
            rig = place_world(calibration.rig, after.xyz, tracks.skeleton, config.stature, level=True)
        new_from_old = rig.cam_from_world[0, :3, :3].T @ calibration.rig.cam_from_world[0, :3, :3]
        turned = float(np.degrees(np.arccos(np.clip(new_from_old[2, 2], -1, 1))))
    note = note or _described_offsets(clip, calibration.offset, config.extrinsics)
    return Refined(rig, calibration.offset, calibration.drift, covariance, changes, floor, turned, note)


def _named_views(rig: CameraRig, config: RefineConfig) -> list[int] | None:
    """Return the indices of the cameras that may change; None to find them."""
    unknown = [name for name in config.cameras if name not in rig.names]
    if unknown and config.cameras not in ([AUTO], [ALL]):
        given = f"refine.cameras=[{','.join(config.cameras)}]"
        raise ValueError(f"{given}: expected auto, all or some of {', '.join(rig.names)}")
    if not config.frees_cameras:
        return []
    if config.cameras == [AUTO]:
        return list(range(len(rig))) if config.offsets or config.drift else None
    if config.cameras == [ALL]:
        return list(range(len(rig)))
    return [rig.names.index(name) for name in config.cameras]


def _differing(clip: Clip) -> tuple[Calibration, list[int], str | None, ImageTracks | None]:
    """Return the calibration without clear differences, the cameras that had them, why there are none, and tracks.

    The tracks were matched with this calibration; None if no tracks were matched.
    """
    calibration, found, tracks = Calibration.of(clip.rig), None, None
    views: list[int] = []
    late: list[int] = []
    for _ in range(max(len(clip.rig) - 2, 0)):
        tracks = match_tracks(replace(clip, rig=calibration.rig))
        found = examine(tracks, calibration) if tracks.xy.shape[1] else None
        if found is None or not found.kinds or found.kinds[0].view in (*views, *late):
            break
        best, tracks = found.kinds[0], None
        # A camera that is only late stays where it is.
        if {each.kind for each in found.kinds} == {Kind.late}:
            late.append(best.view)
            calibration = calibration.with_step(best.view, best.step)
        else:
            views.append(best.view)
            calibration = calibration.with_step(best.view, np.where(np.arange(Q) == OFFSET, 0, best.step))
    return calibration, sorted(views), None if views or late else _why_none(clip.rig, found), tracks


def _described_offsets(clip: Clip, offset: np.ndarray, placed: bool) -> str | None:
    """Say which cameras are late by offsets (V,), s, and how to undo it; None if none is by half a frame."""
    frames = -offset * clip.fps
    given = np.array(clip.provenance.get("offsets") or [0] * len(frames))
    if not (np.abs(frames) > 0.5).any():
        return None
    those = ", ".join(
        f"{name} started {abs(number):.1f} frames {'late' if number > 0 else 'early'}"
        for name, number in zip(clip.rig.names, frames, strict=True)
        if abs(number) > 0.5
    )
    before, now = (
        ",".join(f"{name}:{number}" for name, number in zip(clip.rig.names, whole.tolist(), strict=True) if number)
        for whole in (given, given + np.rint(frames).astype(int))
    )
    instead = f" instead of data.offsets=[{before}]" if before else ""
    doubt = "" if placed else "; a displaced camera seems late while its place is kept: compare refine.extrinsics=true"
    return f"{those}; calibration files cannot state that: give data.offsets=[{now}]{instead}{doubt}"


def _why_none(rig: CameraRig, found: Examination | None) -> str:
    if len(rig) < 3:
        return "with two cameras it is not determined which one differs: give its name as refine.cameras=[...]"
    if found is None:
        return (
            f"people are seen for less than {SHORTEST_S:g} s, too short to find a camera that differs: "
            "give its name as refine.cameras=[...]"
        )
    if found.suspects:
        names = " or ".join(rig.names[view] for view in found.suspects)
        return f"{names} seems to differ, which is not certain: give its name as refine.cameras=[...]"
    return "no camera clearly differs from its calibration; refine.cameras=[all] refines all cameras"


def _changes(
    origin: Calibration,
    calibration: Calibration,
    covariance: np.ndarray,
    views: list[int],
    before: Adjusted,
    after: Adjusted,
    fps: float,
) -> tuple[CameraChange, ...]:
    step = origin.difference(calibration)
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    changes = []
    for view, name in enumerate(origin.rig.names):
        free = view in views
        residuals = [_median(each.error_px[:, view]) for each in (before, after)]
        changes.append(
            CameraChange(
                name,
                free,
                float(100 * np.linalg.norm(step[view, CENTRE])),
                float(np.degrees(np.linalg.norm(step[view, ROTATION]))),
                float(np.exp(step[view, FOCAL])),
                float(calibration.rig.dist[view, 0]),
                float(0 - calibration.offset[view] * fps),
                float(0 - calibration.drift[view] * fps * 60),
                float(100 * np.sqrt(variance[view, CENTRE].mean())) if free else None,
                float(np.degrees(np.sqrt(variance[view, ROTATION].mean()))) if free else None,
                float(fps * np.sqrt(variance[view, OFFSET])) if variance[view, OFFSET] else None,
                *residuals,
            )
        )
    return tuple(changes)


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None
