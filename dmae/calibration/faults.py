"""Faults: what is commonly wrong with calibrations and detections."""

from enum import StrEnum


class Fault(StrEnum):
    """A fault of a recording; its value is the text that is printed."""

    inverse = "extrinsics are inverse"
    centre = "translation is the camera's centre"
    transposed_rotation = "rotation is transposed"
    focal = "focal lengths are swapped"
    principal = "principal point is swapped"
    mirrored = "x is mirrored"
    flipped = "y is flipped"
    upside_down = "image is upside down"
    turned_left = "image is turned left"
    turned_right = "image is turned right"
    swapped_axes = "x and y are swapped"
    scale = "detections are of another resolution"
    distorted = "distortion is ignored"
    undistorted = "distortion was removed already"
    distortion_sign = "distortion has the wrong sign"
    order = "cameras are exchanged"
    delay = "cameras are not synchronised"
    unit = "unit of length is wrong"
    up = "another axis is up"
    size = "image size is transposed"
    unexplained = "calibration and detections disagree"
