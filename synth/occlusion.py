"""How much of people is hidden from how many cameras, and scenes in which it is as much as was asked for."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Visibility
from dmae.images import FIRST_OBJECT_ID
from dmae.rng import Stream, generator
from synth.control import find_joints
from synth.interactions import InteractionConfig
from synth.landmarks import landmarks
from synth.motion.source import MotionConfig
from synth.props import PropsConfig
from synth.quality import FailedSimulation
from synth.reference import make_reference
from synth.sample import load_motions, sample_spec
from synth.scene import Scene, add_prop, build_scene
from synth.simulate import joint_places, moved_with, plan_motions
from synth.spec import Layout, PropSpec, SceneConfig, SceneSpec
from synth.visibility import joint_visibility

DETECTED = slice(0, 25)
"""Of the joints of `synth.landmarks.SKELETON`, those that detectors find: BODY_25."""
_FRAMES = 12
"""Of a clip that are looked at to estimate what is hidden in it."""
_THINGS = 14
"""Of which as many are left out as hide too much."""
_SPREAD = 3.0
"""How many times wider or narrower than configured people gather at most."""
_MARGIN, _FAR = 0.15, 0.2
"""What is foreseen must lie within a target by this share of its width. Missing it by this share of joints takes
people all the way from keeping apart to crowding together; missing it by half of that even then is hopeless."""


@dataclass(frozen=True)
class OcclusionConfig:
    """How much is to be hidden: a share of the joints that a detector would find (BODY_25), over a clip.

    Attributes:
        target: Least and greatest share of joints that are hidden in at least `views` cameras; empty for as it comes.
            Where people go and gather, how many things there are and where they stand follow from it:
            `scene.gathering` is only where the search begins, and of `scene.props` only the fewest count.
        views: In how many cameras a joint must be hidden to count.
        by_self: Whether joints count that are hidden by their own person's body, which no layout changes.
        layouts: How many layouts are tried before the people are drawn anew.
    """

    target: list[float] = field(default_factory=list)
    views: int = 3
    by_self: bool = True
    layouts: int = 12

    def __post_init__(self):
        if self.target and not (len(self.target) == 2 and 0 <= self.target[0] < self.target[1] <= 1):
            raise ValueError(
                f"occlusion.target: expected [least, greatest] share of joints, 0 <= least < greatest <= 1, "
                f"got {list(self.target)}"
            )
        for name in ("views", "layouts"):
            if getattr(self, name) < 1:
                raise ValueError(f"occlusion.{name}: expected 1 or more, got {getattr(self, name)}")

    def check(self, rig: CameraRig) -> None:
        """Raises ValueError where a target counts more cameras than there are."""
        if self.target and self.views > len(rig):
            raise ValueError(
                f"occlusion.views: a joint cannot be hidden in {self.views} cameras, the rig has {len(rig)}; "
                f"expected 1 to {len(rig)}"
            )


def histogram(visibility: np.ndarray, *, by_self: bool = True) -> np.ndarray:
    """Shares of the joints that are hidden in 0, 1, ... V cameras.

    Args:
        visibility: (F, V, P, J) `Visibility`. Joints of people who are not in the scene do not count; outside the
            image is not hidden.
        by_self: Whether to count what a person's own body hides.

    Returns:
        (V + 1,), summing to 1; all zero where nobody is.
    """
    first = Visibility.HIDDEN_BY_SELF if by_self else Visibility.HIDDEN_BY_PERSON
    hidden = (visibility >= first) & (visibility <= Visibility.HIDDEN_BY_OBJECT)
    count = hidden.sum(1)[(visibility != Visibility.ABSENT).any(1)]
    return np.bincount(count, minlength=visibility.shape[1] + 1) / max(1, count.size)


def summary(visibility: np.ndarray, config: OcclusionConfig) -> dict:
    """What a manifest says of a clip's occlusion.

    Args:
        visibility: (F, V, P, J) `Visibility` of the joints of `synth.landmarks.SKELETON`.
        config: What was asked for.

    Returns:
        The share of all joints in each state, by its name; `hidden_in`, the shares of the detectors' joints that are
        hidden in 0, 1, ... V cameras, and `hidden_in_by_others`, the same without what people hide of themselves. If
        there was a `target` also that, `views`, `by_self`, and the `share` achieved.
    """
    found = {code.name.lower(): round(float((visibility == code).mean()), 4) for code in Visibility}
    joints = visibility[..., DETECTED]
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
    """Share of the joints that count as hidden; (F, V, P, J) as for `summary`."""
    return float(histogram(visibility[..., DETECTED], by_self=config.by_self)[config.views :].sum())


def confirm(visibility: np.ndarray, config: OcclusionConfig) -> None:
    """Make sure that a clip is what was asked for; (F, V, P, J) as for `summary`.

    Raises:
        FailedSimulation: it is not; the message says what would help.
    """
    found = share(visibility, config)
    if config.target and not config.target[0] <= found <= config.target[1]:
        raise _unmet([histogram(visibility[..., DETECTED], by_self=config.by_self)], config)


def sample_hidden_spec(
    scene: SceneConfig,
    motion: MotionConfig,
    props: PropsConfig,
    config: OcclusionConfig,
    rig: CameraRig,
    interaction: InteractionConfig | None = None,
    *,
    seed: int,
    clip: int,
) -> SceneSpec:
    """Draw the scene of one clip so that about as much is hidden as was asked for; see `synth.sample.sample_spec`.

    A layout is drawn with many things, and of these so many are left out that what remains hides a share drawn from
    the target. If even all of them hide too little, people gather closer in the next layout; if people alone hide too
    much, they keep farther apart. What is hidden is foreseen from the paths that people mean to take, before physics.

    Raises:
        FailedSimulation: no layout does; the message says what would help.
        ValueError: the configuration asks for what is not there.
    """
    config.check(rig)
    inset = _MARGIN * (config.target[1] - config.target[0])
    low, high = config.target[0] + inset, config.target[1] - inset
    aim = float(generator(seed, clip, Stream.LAYOUT).uniform(low, high))
    base, found, closeness = None, [], 0.5
    for draw in range(config.layouts):
        layout = _layout(scene, closeness, draw, rig)
        try:
            spec = sample_spec(scene, motion, props, layout, interaction, seed=seed, clip=clip)
        except FailedSimulation:
            # No room for people who gather like this; another draw may do.
            continue
        base = base or build_scene(replace(spec, props=()), rig)
        foresight = _Foresight(spec, base, rig, config)
        fewest, most = min(scene.props[0], len(spec.props)), len(spec.props)
        for count in _counts(foresight.share, fewest, most, aim):
            if low <= foresight.share(count) <= high:
                return replace(spec, props=spec.props[:count])
        found += foresight.histograms.values()
        short = _miss(foresight.share(fewest), foresight.share(most), low, high)
        wanted = float(np.clip(closeness + short / _FAR, 0, 1))
        if abs(short) > _FAR / 2 and wanted == closeness:
            break
        closeness = wanted
    if not found:
        raise FailedSimulation(
            f"no room for people in any of {config.layouts} layouts; fewer people (scene.persons), shorter clips or a "
            "larger scene.radius would help"
        )
    raise _unmet(found, config)


def _counts(share: Callable[[int], float], fewest: int, most: int, aim: float) -> tuple[int, ...]:
    """How many things hide just more and just less than is aimed at; more things hide no less."""
    if share(fewest) >= aim:
        return (fewest,)
    if share(most) <= aim:
        return (most,)
    while most - fewest > 1:
        middle = (fewest + most) // 2
        if share(middle) < aim:
            fewest = middle
        else:
            most = middle
    return most, fewest


def _miss(fewest: float, most: float, low: float, high: float) -> float:
    """By how much too little (> 0) or too much (< 0) is hidden, whatever number of things there is."""
    return min(0.0, high - fewest) + max(0.0, low - most)


def _layout(scene: SceneConfig, closeness: float, draw: int, rig: CameraRig) -> Layout:
    """A layout with many things, of people who keep apart (closeness 0) or crowd together (1)."""
    nearest, farthest = scene.clearance
    return Layout(
        draw=draw,
        gathering=scene.gathering * _SPREAD ** (1 - 2 * closeness),
        clearance=farthest + closeness * (nearest - farthest),
        props=max(_THINGS, scene.props[0]),
        before=tuple((float(x), float(y)) for x, y in rig.centers[:, :2]),
    )


class _Foresight:
    """What cameras will see in a few frames of a scene if everybody does as planned."""

    def __init__(self, spec: SceneSpec, base: Scene, rig: CameraRig, config: OcclusionConfig):
        """Args:
        spec: The scene, P people.
        base: Its room and people, without things.
        rig: V cameras.
        config: What is asked for.
        """
        bodies, model = [person.body for person in spec.persons], base.model
        _, discs = _build_things(spec.props)
        plan = plan_motions(spec, load_motions(spec), np.concatenate([base.obstacles, discs]))
        frames = np.unique(np.linspace(0, len(plan.root) - 1, _FRAMES).round().astype(int))
        reference = make_reference(plan.root[frames], plan.rotations[frames], plan.bearing[frames], spec.fps, 1)
        joints = find_joints(model, len(bodies))
        qpos = np.tile(model.qpos0, (len(frames), 1))
        joints.root(qpos)[:], joints.quats(qpos)[:] = reference.root, reference.quats
        self._spec, self._rig, self._config = spec, rig, config
        self._places = joint_places(model, qpos, bodies)
        self._depth = np.stack([landmarks(body)[2] for body in bodies])
        self._without = joint_visibility(
            model, qpos, self._places, self._depth, base.geom_ids, rig, moved_with(model, bodies)
        ).visibility

        self.histograms: dict[int, np.ndarray] = {}
        """Those looked at, by how many of the things there were."""

    def share(self, count: int) -> float:
        """Share of the joints that count as hidden with the first so many of the scene's things."""
        if count not in self.histograms:
            joints = self._visibility(count)[..., DETECTED]
            self.histograms[count] = histogram(joints, by_self=self._config.by_self)
        return float(self.histograms[count][self._config.views :].sum())

    def _visibility(self, count: int) -> np.ndarray:
        """(F, V, P, 39) `Visibility`."""
        if not count:
            return self._without
        things, _ = _build_things(self._spec.props[:count])
        ids, still = np.full(things.ngeom, FIRST_OBJECT_ID), np.empty((len(self._places), 0))
        behind = joint_visibility(things, still, self._places, self._depth, ids, self._rig).visibility
        return np.where(behind == Visibility.HIDDEN_BY_OBJECT, behind, self._without)


def _build_things(props: tuple[PropSpec, ...]) -> tuple[mujoco.MjModel, np.ndarray]:
    """Things by themselves: their model, and the (K, 3) discs that they take on the floor, m."""
    world = mujoco.MjSpec()
    discs = [add_prop(world, f"{number}/", prop) for number, prop in enumerate(props)]
    return world.compile(), np.concatenate([np.empty((0, 3)), *discs])


def _unmet(found: list[np.ndarray], config: OcclusionConfig) -> FailedSimulation:
    """What to say where all of the histograms found miss the target."""
    low, high = config.target
    shares = [float(shares[config.views :].sum()) for shares in found]
    least, most = min(shares), max(shares)
    reached = f"{least:.2f}" if most - least < 0.01 else f"{least:.2f} to {most:.2f}"
    others = [views for views in range(1, len(found[0])) if any(low <= h[views:].sum() <= high for h in found)]
    whom = "" if config.by_self else "by others or things "
    more = least < low
    remedies = [
        f"a target around {reached}",
        f"occlusion.views={others[-1]}" if others else f"{'fewer' if more else 'more'} occlusion.views",
        "more people (scene.persons), a smaller scene.radius, or a scene with more to hide behind, as scene=warehouse"
        if more
        else "fewer people (scene.persons), an emptier scene, as scene=studio, or occlusion.by_self=false",
    ]
    listed = "; ".join(f"({number}) {remedy}" for number, remedy in enumerate(remedies, 1))
    return FailedSimulation(
        f"occlusion.target={[low, high]} is not met: of the joints, {reached} are hidden {whom}in at "
        f"least {config.views} of {len(found[0]) - 1} cameras. What would help: {listed}"
    )
