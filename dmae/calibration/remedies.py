"""Remedies in words: the option to give, or the change to make in a file."""

import numpy as np

from dmae.calibration.corrections import Correction
from dmae.calibration.faults import Fault
from dmae.data.cameras import CameraRig
from dmae.formats.config import METRES, Convention, LengthUnit, UpDirection

_IN_DETECTIONS = {
    Fault.mirrored: "replace x by width - 1 - x (and exchange left and right joints if the images were mirrored "
    "before people were detected), or detect in the images as filmed",
    Fault.flipped: "replace y by height - 1 - y: rows count from the top",
    Fault.upside_down: "replace x, y by width - 1 - x, height - 1 - y, or turn the images before detecting",
    Fault.turned_left: "replace x, y by width - 1 - y, x, or turn the images back before detecting",
    Fault.turned_right: "replace x, y by y, height - 1 - x, or turn the images back before detecting",
    Fault.swapped_axes: "exchange x and y: column first, then row",
}
_IN_CALIBRATION = {
    Fault.inverse: "invert the extrinsics: R -> R^T, t -> -R^T t",
    Fault.centre: "t holds the camera's centre C: write t = -R C",
    Fault.transposed_rotation: "transpose R and leave t as it is",
    Fault.focal: "exchange fx and fy (K[0][0] and K[1][1])",
    Fault.principal: "exchange cx and cy (K[0][2] and K[1][2])",
    Fault.undistorted: "set the distortion to 0: the detections come from undistorted images",
    Fault.distortion_sign: "change the sign of the distortion coefficients",
}


def camera_names(rig: CameraRig, views: tuple[int, ...]) -> str:
    """Return cameras by name: "all cameras", "camera a" or "cameras a, b"."""
    if len(views) == len(rig):
        return "all cameras"
    return f"camera{'s' * (len(views) > 1)} {', '.join(rig.names[view] for view in views)}"


def remedy(correction: Correction, before: Convention, has_options: bool, offsets: list[int] | None) -> str:
    """Return the remedy for a fault of geometry or time, as text.

    Args:
        before: The assumed convention of the extrinsics in the files.
        has_options: Whether unit, up and inverse are options of the files' format.
        offsets: Frames by which detections are already delayed; None if some cameras of the files are not read.
    """
    rig, views, fault = correction.hypothesis.rig, correction.views, correction.fault
    names = camera_names(rig, views)
    if fault == Fault.inverse and has_options and len(views) == len(rig):
        return f"data.inverse={str(not before.inverse).lower()}"
    if fault == Fault.delay:
        delay = correction.hypothesis.offsets
        if offsets is not None:
            return f"data.offsets={[int(k) for k in delay + offsets]}".replace(" ", "")
        return "add to data.offsets " + ", ".join(f"{delay[view]:+d} for camera {rig.names[view]}" for view in views)
    if fault == Fault.order:
        a, b = (rig.names[view] for view in views)
        return (
            f"exchange the detections of cameras {a} and {b} (rename their files or folders), or these two names in "
            "the calibration"
        )
    if fault == Fault.scale:
        width, height = np.round(correction.amount * rig.size[views[0]]).astype(int)
        return (
            f"in the calibration of {names}, multiply fx, fy, cx, cy and the image size by {correction.amount:.4g}, or "
            f"detect in images of the size that was calibrated, not of about {width} x {height} px"
        )
    if fault == Fault.distorted:
        k1 = f"k1 is about {correction.amount:.2f}"
        return f"add the lens of {names} to the calibration ({k1}), or detect in undistorted images"
    if fault in _IN_DETECTIONS:
        return f"in the detections of {names}, {_IN_DETECTIONS[fault]}"
    return f"in the calibration of {names}, {_IN_CALIBRATION[fault]}"


def unit_remedy(ratio: float, before: Convention, has_options: bool) -> str | None:
    """Return the remedy for people that are `ratio` times as large as humans, as text; None if their size is right."""
    low, high = 0.45, 1.6
    if low <= ratio <= high:
        return None
    for unit, metres in METRES.items():
        if has_options and low <= ratio * metres / METRES[before.unit] <= high:
            return f"data.unit={unit}"
    power = 10.0 ** -np.round(np.log10(ratio))
    if low <= ratio * power <= high:
        length = {0.001: LengthUnit.mm, 0.01: LengthUnit.cm}.get(power * METRES[before.unit])
        reason = f": they are in {length}" if length else ""
        return f"multiply the translations of all cameras by {power:g}{reason}"
    return (
        f"multiply the translations of all cameras by about {1 / ratio:.2g}: was the square of the calibration board "
        "measured, and in the same unit?"
    )


def up_remedy(direction: np.ndarray, before: Convention, has_options: bool) -> str | None:
    """Return the remedy if people stand along `direction` (3,) instead of z, as text; None if they stand along z."""
    steep = 0.8
    if direction[2] >= steep:
        return None
    axis = before.written_points(direction) * METRES[before.unit]
    for up in UpDirection:
        if Convention(up=up).points(axis)[2] >= steep:
            if has_options:
                return f"data.up={up}"
            R = Convention(up=up).points(np.eye(3)).T.round().astype(int).tolist()
            return f"in all extrinsics, replace R by R Q^T, where Q = {R} turns {up} into z"
    components = ", ".join(f"{x:.2f}" for x in axis)
    return f"turn the world of the calibration so that ({components}) becomes z: data.up has no name for it"
