"""Find body segments from optical markers on the skin."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion.rotations import about, aligned
from synth.people.segments import SEGMENTS

_SIDED = ("FWT", "BWT", "SHO", "ELB", "WRA", "WRB", "FIN", "KNE", "ANK", "HEE", "TOE", "MT5", "FHD", "BHD")
MARKERS = ("C7", "T10", "CLAV", "STRN", *(side + name for side in "LR" for name in _SIDED))
"""The markers from which joints are found, of the 41 markers of CMU's database."""
SYNONYMS = {f"{side}{theirs}": f"{side}{ours}" for side in "LR" for theirs, ours in (("ASI", "FWT"), ("PSI", "BWT"))}
"""Names of markers at the same places in Vicon's Plug-in Gait set."""

# Joint centres relative to a marker, as fractions of a nearby length: along x, outward, and along z of axes that
# markers define; and rotations from these axes to the segment's own axes. Measured on CMU's subject 2, for which there
# are markers and the Acclaim skeleton that CMU solved from them: takes 02_01 and 02_05, mean of both sides.
_HIP = (0.125, 0.343, -0.410)
_SHOULDER = (0.062, 0.074, -0.124)
_ELBOW = (0.049, -0.065, -0.146)
_WRIST = (0.038, 0.088, -0.159)
_KNEE = (0.021, -0.172, -0.003)
_ANKLE = (-0.025, -0.110, -0.009)
_HEAD_PITCH, _HAND_PITCH, _FOOT_ROLL = np.radians((30.0, -27.0, 10.0))
_SPINE_SHARE = 0.63
"""Share of the turn from pelvis to chest that the lumbar spine makes."""
_HINGE_DOUBT = 0.4
"""Weight of the prior on the hinge axis of an elbow or a knee, as the sine of the bend at which both count the same."""


def segments(marker: dict[str, np.ndarray], path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return hips, ankles and orientations from markers.

    Joint centres are at fixed positions relative to the markers, in proportion to the body. Limbs point from joint to
    joint. The hinge axis of an elbow or knee is orthogonal to the plane in which the limb bends. If the limb hardly
    bends, the line between the two markers of the wrist, or the pelvis, determines the axis.

    Args:
        marker: (F, 3) of each of `MARKERS`, in any unit, in axes with z up. The markers of the fifth
            metatarsals may be missing.
        path: The file, for messages.

    Returns:
        hips: (F, 2, 3) left and right, in the markers' unit.
        ankles: (F, 2, 3) left and right, in the markers' unit.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        leg: Length of thigh and shin together, mean of both legs, in the markers' unit.

    Raises:
        ValueError: two markers coincide that must be at different positions.
    """

    def middle(*names: str) -> np.ndarray:
        return np.mean([marker[name] for name in names], axis=0)

    def across(front: str, back: str) -> np.ndarray:
        """Return axes from four markers around the body: y exactly left, and x as close to forward as possible."""
        left = middle(f"L{front}", f"L{back}") - middle(f"R{front}", f"R{back}")
        return aligned(left, middle(f"L{front}", f"R{front}") - middle(f"L{back}", f"R{back}"), (0, 1, 0))

    _check_apart(marker, path)
    pelvis, skull = across("FWT", "BWT"), across("FHD", "BHD")
    ribs = aligned(
        middle("C7", "CLAV") - middle("T10", "STRN"), middle("CLAV", "STRN") - middle("C7", "T10"), (0, 0, 1)
    )
    bend = Rotation.from_matrix(pelvis.swapaxes(1, 2) @ ribs).as_rotvec()
    turn = {
        "pelvis": pelvis,
        "spine": pelvis @ Rotation.from_rotvec(_SPINE_SHARE * bend).as_matrix(),
        "chest": ribs,
        "head": skull @ about("y", _HEAD_PITCH),
    }
    waist = _distance(marker["LFWT"], marker["RFWT"])
    hips, ankles, legs = [], [], []
    for side, outward in (("l", 1.0), ("r", -1.0)):
        sho, elb, wra, wrb, fin, kne, ank, hee, toe = (
            marker[side.upper() + name] for name in ("SHO", "ELB", "WRA", "WRB", "FIN", "KNE", "ANK", "HEE", "TOE")
        )
        mirrored, out, down = np.array((1, outward, 1)), (0, outward, 0), (0, 0, -1)

        bar, lower = wra - wrb, (wra + wrb) / 2 - elb
        arm, forearm = _distance(sho, elb), _distance(elb, (wra + wrb) / 2)
        shoulder = sho + ribs @ (_SHOULDER * mirrored * arm)
        wrist = elb + lower + aligned(lower, bar, out) @ (_WRIST * mirrored * forearm)
        elbow = elb
        # The first estimate of the joint centre gives an approximate hinge axis. The axis gives a better centre.
        for _ in range(2):
            upper, lower = elbow - shoulder, wrist - elbow
            prior = outward * np.cross(_unit(bar), _unit(lower))
            hinge = outward * np.cross(_unit(lower), _unit(upper)) + _HINGE_DOUBT * prior
            elbow = elb + aligned(elb - sho, np.cross(outward * (elb - sho), hinge), out) @ (_ELBOW * mirrored * arm)
        upper = elbow - shoulder
        turn[f"{side}_upper_arm"] = aligned(upper, np.cross(outward * upper, hinge), out)
        turn[f"{side}_forearm"] = aligned(wrist - elbow, bar, out)
        turn[f"{side}_hand"] = aligned(fin - wrist, bar, out) @ about("x", outward * _HAND_PITCH)

        hip = middle("LFWT", "RFWT", "LBWT", "RBWT") + pelvis @ (_HIP * mirrored * waist)
        shank, length = ank - kne, _distance(kne, ank)
        little = marker.get(f"{side.upper()}MT5")
        sole = np.cross(toe - hee, outward * (little - toe) if little is not None else pelvis[..., 1])
        foot = aligned(sole, toe - hee, (0, 0, 1))
        ankle = ank + foot @ (_ANKLE * mirrored * length)
        knee = kne
        for _ in range(2):
            hinge = np.cross(_unit(knee - hip), _unit(ankle - knee)) + _HINGE_DOUBT * pelvis[..., 1]
            knee = kne + aligned(shank, np.cross(shank, hinge), down) @ (_KNEE * mirrored * length)
        turn[f"{side}_thigh"] = aligned(knee - hip, np.cross(knee - hip, hinge), down)
        turn[f"{side}_shin"] = aligned(ankle - knee, np.cross(ankle - knee, hinge), down)
        turn[f"{side}_foot"] = foot if little is None else foot @ about("x", outward * _FOOT_ROLL)
        hips.append(hip)
        ankles.append(ankle)
        legs.append(_distance(hip, knee) + _distance(knee, ankle))
    rotations = np.stack([turn[name] for name in SEGMENTS], axis=1)
    return np.stack(hips, axis=1), np.stack(ankles, axis=1), rotations, sum(legs) / 2


def _check_apart(marker: dict[str, np.ndarray], path: Path) -> None:
    """Raise ValueError if markers that define a direction or a distance coincide."""
    around = [("CLAV", "C7"), ("STRN", "T10"), ("C7", "T10"), ("LFWT", "RFWT"), ("LFHD", "RFHD")]
    pairs = ("FWT BWT", "FHD BHD", "SHO ELB", "ELB WRA", "WRA WRB", "WRA FIN", "FWT KNE", "KNE ANK", "HEE TOE")
    around += [tuple(side + name for name in pair.split()) for side in "LR" for pair in pairs]
    least = 0.02 * (_distance(marker["LSHO"], marker["LANK"]) + _distance(marker["RSHO"], marker["RANK"])) / 2
    together = [f"{one} and {other}" for one, other in around if not _distance(marker[one], marker[other]) > least]
    if together:
        raise ValueError(f"{path}: expected markers apart that lie at the same place: {', '.join(together)}")


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(one - other, axis=1)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
