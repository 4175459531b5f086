"""What mistakes a 2D pose detector makes: its configuration."""

from dataclasses import dataclass, field, fields


@dataclass(frozen=True)
class PartConfig:
    """How a detector does on one kind of joint.

    Attributes:
        noise: Scale of Student's t of a pixel coordinate's error where the joint is visible, as a fraction of the
            person's height in the image.
        tail: Degrees of freedom of that distribution: 2 has a long tail, 30 is nearly Gaussian.
        score: (a, b) of the Beta distribution of the confidence of visible joints; (1, 0) is always 1.
        miss: Share of joints missed where visible, hidden by the person itself, by another, by an object. Shares
            other than 0 and 1 are averaged with those of the limb's joints, but for the face.
        offset: Where the detector puts the joint, seen from where it is annotated: outwards, as a fraction of the
            distance to its partner of the other side, and down the trunk, as a fraction of the way from neck to
            middle of the hips, both as the image has them.
    """

    noise: float = 0.0
    tail: float = 30.0
    score: list[float] = field(default_factory=lambda: [1.0, 0.0])
    miss: list[float] = field(default_factory=lambda: [0.0, 1.0, 1.0, 1.0])
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def __post_init__(self):
        for name, length in (("score", 2), ("miss", 4), ("offset", 2)):
            found = getattr(self, name)
            if len(found) != length:
                raise ValueError(f"detector part: expected {length} numbers of {name}, got {list(found)}")
        if not self.noise >= 0 or not self.tail > 0 or not all(0 <= share <= 1 for share in self.miss):
            raise ValueError(
                f"detector part: expected noise >= 0, tail > 0 and shares of misses from 0 to 1, got {self}"
            )
        check_beta("detector part: score", self.score)


def check_beta(name: str, shape: list[float]) -> None:
    """ValueError unless these are the (a, b) of a Beta distribution, or b is 0, which is always 1."""
    if len(shape) != 2 or not shape[0] > 0 or not shape[1] >= 0:
        raise ValueError(f"{name}: expected a > 0 and b >= 0 of a Beta distribution, got {list(shape)}")


@dataclass(frozen=True)
class PartsConfig:
    """How a detector does on each kind of joint, left and right alike."""

    nose: PartConfig = field(default_factory=PartConfig)
    neck: PartConfig = field(default_factory=PartConfig)
    shoulder: PartConfig = field(default_factory=PartConfig)
    elbow: PartConfig = field(default_factory=PartConfig)
    wrist: PartConfig = field(default_factory=PartConfig)
    mid_hip: PartConfig = field(default_factory=PartConfig)
    hip: PartConfig = field(default_factory=PartConfig)
    knee: PartConfig = field(default_factory=PartConfig)
    ankle: PartConfig = field(default_factory=PartConfig)
    eye: PartConfig = field(default_factory=PartConfig)
    ear: PartConfig = field(default_factory=PartConfig)
    big_toe: PartConfig = field(default_factory=PartConfig)
    small_toe: PartConfig = field(default_factory=PartConfig)
    heel: PartConfig = field(default_factory=PartConfig)


@dataclass(frozen=True)
class DetectorConfig:
    """A 2D pose detector of BODY25. As it stands here: all that is visible, nothing that is not, without error.

    Each effect has a random stream of its own: changing one leaves what the others draw as it is. Effects apply in
    the order in which they stand here, but for the times of exposure, which come first.

    Attributes:
        name: For people to read.
        parts: By kind of joint.
        view_offset: Standard deviation of an offset that all people have in common at a joint in a view, as a fraction
            of a person's height in the image.
        bias: Share of the error's energy that is a constant of person, view and joint; long tails dilute it.
        correlation: Time in which the rest of the error forgets itself, s: half of it to 1/e in three times that, half
            in a third of it. Scores and ghosts forget their luck in this time.
        least_noise: What is added to the scale of errors however small a person is, px; squares add up.
        blur: The same for motion, as a share of the way that a joint goes in the image from frame to frame.
        cut_noise: By how much errors grow with the share of a person's joints that is outside the image: by a factor
            of 1 + `cut_noise` * share.
        guess_noise: Error at hidden joints that are detected all the same, relative to that at visible ones.
        guess_score: (a, b) of the Beta distribution of the confidence at hidden joints.
        score_knows: Correlation, 0 to 1, between the ranks of a confidence and of the error it goes with.
        least_score: Joints of less confidence are not reported.
        bursts: Times over which mistakes hang together, s: a long and a short one, mixed half and half. How large
            errors are hangs together over the long one.
        together: Correlation of misses within an arm, a leg with its heel, the toes of a foot, the face and the trunk.
        hanging: Share of the joints next to a missed one, outwards, that are missed with it, as detectors lose them
            that join parts to people: wrists of elbows, ankles of knees, feet of ankles, eyes of the nose, ears
            where both eye and shoulder are missed.
        person_miss: Share of frames in which a person in full view is missed whole.
        person_miss_hidden: The same of a person that is wholly hidden or outside the image; in between it grows
            with the cube of the share of joints that are.
        swap: Share of the detected joints that are hidden by another person, or have another person's near by, that
            land on that one.
        leg_inversion, arm_inversion: Share of frames in which left and right knee, ankle and foot, or elbow and wrist
            are taken for each other.
        merge: Share of frames in which two people become one where one's box in the image lies within the other's;
            of less where they overlap less. Some limbs of the one, if detected, take the place of the other's.
        merge_rest: Share of merged people whose remaining joints are reported as well.
        split: Share of frames in which a person is reported in two pieces: upper and lower, or left and right.
        ghosts: Mean number of false persons in a view and frame, at fixed places in the image.
        ghost_joints: Share of a false person's joints that are reported.
        ghost_score: (a, b) of the Beta distribution of their confidence.
        drop: Share of a view's frames that are lost, in bursts of the short time.
        drop_repeats: Whether detections of the last frame before stand in for those of a lost one.
        out_of_step: Each view shows another time than its frame's, by a constant that is drawn evenly from minus to
            plus so many frames.
        rolling: Time from the exposure of an image's first row to that of its last, s.
    """

    name: str = "clean"
    parts: PartsConfig = field(default_factory=PartsConfig)
    view_offset: float = 0.0
    bias: float = 0.0
    correlation: float = 0.1
    least_noise: float = 0.0
    blur: float = 0.0
    cut_noise: float = 0.0
    guess_noise: float = 1.0
    guess_score: list[float] = field(default_factory=lambda: [1.0, 0.0])
    score_knows: float = 0.0
    least_score: float = 0.0
    bursts: list[float] = field(default_factory=lambda: [3.0, 0.4])
    together: float = 0.0
    hanging: float = 0.0
    person_miss: float = 0.0
    person_miss_hidden: float = 0.0
    swap: float = 0.0
    leg_inversion: float = 0.0
    arm_inversion: float = 0.0
    merge: float = 0.0
    merge_rest: float = 0.5
    split: float = 0.0
    ghosts: float = 0.0
    ghost_joints: float = 0.45
    ghost_score: list[float] = field(default_factory=lambda: [5.0, 4.0])
    drop: float = 0.0
    drop_repeats: bool = False
    out_of_step: float = 0.0
    rolling: float = 0.0

    def __post_init__(self):
        for one in fields(self):
            found = getattr(self, one.name)
            if one.name in _AMOUNTS:
                if not 0 <= found < float("inf"):
                    raise ValueError(f"detector.{one.name}: expected 0 or more, got {found}")
            elif one.type is float and not 0 <= found <= 1:
                raise ValueError(f"detector.{one.name}: expected a share from 0 to 1, got {found}")
        for name in ("guess_score", "ghost_score"):
            check_beta(f"detector.{name}", getattr(self, name))
        if self.ghosts and not 0 < self.ghost_joints < 1:
            raise ValueError(f"detector.ghost_joints: expected a share above 0 and below 1, got {self.ghost_joints}")
        if len(self.bursts) != 2 or not min(self.bursts) > 0:
            raise ValueError(f"detector.bursts: expected two times above 0 s, got {list(self.bursts)}")


_AMOUNTS = (
    "view_offset", "correlation", "least_noise", "blur", "cut_noise", "guess_noise", "ghosts", "out_of_step", "rolling",
)  # fmt: skip
"""Numbers that are no shares."""
