"""Occlusion of people: its measurement and summary, and scenes that meet a target."""

from bisect import bisect_left
from dataclasses import replace

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import Visibility
from dmae.data.rng import Stream, generator
from synth.datasets.config import GenerateConfig, OcclusionConfig
from synth.errors import FailedSimulation
from synth.labels.visibility import joint_visibility
from synth.people.body import landmarks
from synth.physics.body_state import joint_positions, moved_with
from synth.physics.controller import find_joints, make_reference
from synth.physics.planning import plan_motions
from synth.scene.build import Scene, add_prop, build_scene
from synth.scene.sampling import SampledScene, lay_out, sample_people
from synth.scene.spec import PLAN_FPS, PropSpec

DETECTED = slice(0, 25)
"""The joints of `synth.people.body.SKELETON` that detectors find: BODY_25."""


def histogram(visibility: np.ndarray, *, by_self: bool = True) -> np.ndarray:
    """Return the fractions (V + 1,) of joints that are hidden in 0, 1, ... V cameras; all zero if no person is present.

    `visibility` is (F, V, P, J) `Visibility`. Joints of absent persons do not count. A joint outside the image does not
    count as hidden; one hidden by the person's own body does if `by_self`.
    """
    first = Visibility.HIDDEN_BY_SELF if by_self else Visibility.HIDDEN_BY_PERSON
    hidden = (visibility >= first) & (visibility <= Visibility.HIDDEN_BY_OBJECT)
    count = hidden.sum(1)[(visibility != Visibility.ABSENT).any(1)]
    return np.bincount(count, minlength=visibility.shape[1] + 1) / max(1, count.size)


def summary(visibility: np.ndarray, config: OcclusionConfig) -> dict:
    """Return a clip's occlusion for the manifest, from (F, V, P, J) `Visibility` of the joints of `SKELETON`.

    All fractions are of the joints of BODY_25, as in `synth.datasets.statistics`: with each `Visibility`, by its name;
    `hidden_in`, of joints that are hidden in 0, 1, ... V cameras; and `hidden_in_by_others`, the same without occlusion
    by a person's own body. If the configuration has a `target`: also `target`, `views`, `by_self`, and the achieved
    `share`.
    """
    joints = visibility[..., DETECTED]
    found: dict = {code.name.lower(): round(float((joints == code).mean()), 4) for code in Visibility}
    found["hidden_in"] = histogram(joints).round(4).tolist()
    found["hidden_in_by_others"] = histogram(joints, by_self=False).round(4).tolist()
    if config.target:
        found |= {
            "target": list(config.target),
            "views": config.views,
            "by_self": config.by_self,
            "share": round(share(visibility, config), 4),
        }
    return found


def share(visibility: np.ndarray, config: OcclusionConfig) -> float:
    """Return the fraction of the joints that count as hidden; (F, V, P, J) as for `summary`."""
    return hidden_share(histogram(visibility[..., DETECTED], by_self=config.by_self), config.views)


def hidden_share(hidden_in: np.ndarray, views: int | None) -> float:
    """Return the fraction of joints hidden from `views` cameras or more; without `views` from a camera, on average."""
    if views is None:
        return float(hidden_in @ np.arange(len(hidden_in))) / (len(hidden_in) - 1)
    return float(hidden_in[views:].sum())


def confirm(visibility: np.ndarray, config: OcclusionConfig) -> None:
    """Raise FailedSimulation if a clip does not meet the target; (F, V, P, J) as for `summary`."""
    found = share(visibility, config)
    if config.target and not config.target[0] <= found <= config.target[1]:
        raise unmet([histogram(visibility[..., DETECTED], by_self=config.by_self)], config)


def unmet(found: list[np.ndarray], config: OcclusionConfig) -> FailedSimulation:
    """Return the error for a target that none of these histograms meets."""
    low, high = config.target
    shares = [hidden_share(each, config.views) for each in found]
    least, most = min(shares), max(shares)
    reached = f"{least:.2f}" if most - least < 0.01 else f"{least:.2f} to {most:.2f}"
    counts = range(1, len(found[0]))
    others = [views for views in counts if any(low <= hidden_share(each, views) <= high for each in found)]
    of = f"{len(counts)} cameras"
    how = f"from a camera, the mean of {of}" if config.views is None else f"in at least {config.views} of {of}"
    by_others = "" if config.by_self else "by others or objects "
    more = least < low
    remedies = [
        f"a target around {reached}",
        *([f"occlusion.views={others[-1]}, which counts joints hidden from so many cameras"] if others else []),
        "more people (scene.persons), a smaller scene.radius, or a scene with more objects, as scene=warehouse"
        if more
        else "fewer people (scene.persons), an emptier scene, as scene=studio, or occlusion.by_self=false",
    ]
    listed = "; ".join(f"({number}) {remedy}" for number, remedy in enumerate(remedies, 1))
    return FailedSimulation(
        f"occlusion.target={[low, high]} is not met: of the joints, {reached} are hidden {by_others}"
        f"{how}. What would help: {listed}"
    )


# Sample scenes that meet a target occlusion.

_FRAMES = 12
"""Number of frames of a clip in which its occlusion is predicted."""
_LAYOUTS = 12
"""Number of layouts that are tried before the people are drawn again."""
_PROPS = 14
"""Number of props in a layout. Some of them are removed later."""
_SPREAD = 3.0
"""Greatest factor by which the gathering of people is made wider or narrower than configured."""
_MARGIN, _FAR = 0.15, 0.2
"""The prediction must be inside the target range by a margin of this fraction of its width. If it misses the range by
the fraction `_FAR` of the joints, people move all the way from keeping apart to crowding together. If it then still
misses by half of `_FAR`, the target cannot be met."""


def sample_hidden_scene(config: GenerateConfig, rig: CameraRig, *, seed: int, clip: int) -> SampledScene:
    """Sample the scene of one clip with the target occlusion; see `synth.scene.sampling.sample_scene`.

    A layout is drawn with many props. Props are removed until the remaining ones hide a fraction that is drawn from the
    target. If all props together hide too little, people gather closer in the next layout. If people alone hide too
    much, they keep farther apart. Occlusion is predicted from the planned paths of people, before physics.

    Raises:
        FailedSimulation: no layout meets the target; the message says what would help.
        ValueError: the configuration cannot be met.
    """
    scene, target = config.scene, config.occlusion
    if (target.views or 0) > len(rig):
        raise ValueError(
            f"occlusion.views: a joint cannot be hidden in {target.views} cameras, the rig has {len(rig)}; "
            f"expected 1 to {len(rig)}"
        )
    inset = _MARGIN * (target.target[1] - target.target[0])
    low, high = target.target[0] + inset, target.target[1] - inset
    aim = float(generator(seed, clip, Stream.LAYOUT).uniform(low, high))
    people = sample_people(scene, config.motion, config.interaction, seed=seed, clip=clip)
    nearest, farthest = scene.clearance
    cameras = tuple((float(x), float(y)) for x, y in rig.centers[:, :2])
    # People keep apart at closeness 0, and crowd together at 1.
    base, found, closeness = None, [], 0.5
    for rng in generator(seed, clip, Stream.LAYOUT).spawn(_LAYOUTS):
        gathering = scene.gathering * _SPREAD ** (1 - 2 * closeness)
        clearance = farthest + closeness * (nearest - farthest)
        layout = replace(scene, gathering=gathering, props=[max(_PROPS, scene.props[0])] * 2)
        try:
            spec, motions = lay_out(people, layout, config.props, rng=rng, clearance=clearance, cameras=cameras)
        except FailedSimulation:
            # People who gather like this do not fit. Another draw may succeed.
            continue
        base = base or build_scene(replace(spec, props=()), rig, painted=False)
        prediction = _OcclusionPrediction(SampledScene(spec, motions), base, rig, target)
        fewest, most = min(scene.props[0], len(spec.props)), len(spec.props)
        # More props never hide less: try the numbers that hide just more and just less than the aim.
        more = bisect_left(range(most + 1), aim, lo=fewest, key=prediction.share)
        for count in sorted({min(more, most), max(more - 1, fewest)}, reverse=True):
            if low <= prediction.share(count) <= high:
                return SampledScene(replace(spec, props=spec.props[:count]), motions)
        found += prediction.histograms.values()
        # The fraction of joints by which any number of props hides too little (> 0) or too much (< 0).
        short = min(0.0, high - prediction.share(fewest)) + max(0.0, low - prediction.share(most))
        wanted = float(np.clip(closeness + short / _FAR, 0, 1))
        if abs(short) > _FAR / 2 and wanted == closeness:
            break
        closeness = wanted
    if not found:
        raise FailedSimulation(
            f"no room for people in any of {_LAYOUTS} layouts; fewer people (scene.persons), shorter clips or a "
            "larger scene.radius would help"
        )
    raise unmet(found, target)


class _OcclusionPrediction:
    """Prediction of the occlusion in a few frames of a scene, if every person follows the plan."""

    def __init__(self, scene: SampledScene, base: Scene, rig: CameraRig, config: OcclusionConfig):
        """Args:
        scene: P people.
        base: The built scene: its room and people, without props.
        rig: V cameras.
        config: The target.
        """
        spec, motions = scene
        bodies, model = [person.body for person in spec.persons], base.model
        _, discs = _build_props(spec.props)
        plan = plan_motions(spec, motions, np.concatenate([base.obstacles, discs]))
        frames = np.unique(np.linspace(0, len(plan.root) - 1, _FRAMES).round().astype(int))
        reference = make_reference(plan.root[frames], plan.rotations[frames], plan.bearing[frames], PLAN_FPS, 1)
        joints = find_joints(model, len(bodies))
        qpos = np.tile(model.qpos0, (len(frames), 1))
        joints.root(qpos)[:], joints.quats(qpos)[:] = reference.root, reference.quats
        self._spec, self._rig, self._config = spec, rig, config
        self._places = joint_positions(model, qpos, bodies)
        self._depth = np.stack([landmarks(body)[2] for body in bodies])
        self._without_props = joint_visibility(
            model, qpos, self._places, self._depth, base.geom_ids, rig, moved_with(model, bodies),
            seconds=frames / PLAN_FPS,
        ).visibility  # fmt: skip

        self.histograms: dict[int, np.ndarray] = {}
        """Predicted histograms of occlusion, by number of props. They are computed only once."""

    def share(self, count: int) -> float:
        if count not in self.histograms:
            seen = self._without_props
            if count:
                props, _ = _build_props(self._spec.props[:count])
                ids, still = np.full(props.ngeom, FIRST_OBJECT_ID), np.empty((len(self._places), 0))
                behind = joint_visibility(props, still, self._places, self._depth, ids, self._rig).visibility
                seen = np.where(behind == Visibility.HIDDEN_BY_OBJECT, behind, seen)
            self.histograms[count] = histogram(seen[..., DETECTED], by_self=self._config.by_self)
        return hidden_share(self.histograms[count], self._config.views)


def _build_props(props: tuple[PropSpec, ...]) -> tuple[mujoco.MjModel, np.ndarray]:
    """Return a model of the props alone, and the (K, 3) discs that they cover on the floor, m."""
    world = mujoco.MjSpec()
    discs = [add_prop(world, f"{number}/", prop) for number, prop in enumerate(props)]
    return world.compile(), np.concatenate([np.empty((0, 3)), *discs])
