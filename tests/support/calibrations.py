"""One camera as every format of calibrations writes it."""

import json
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

R = Rotation.from_rotvec([1.2, -0.7, 0.4]).as_matrix()
CENTRE = np.array([1.0, -4.0, 1.5])
T = -R @ CENTRE
K = np.array([[900.0, 0, 500], [0, 880, 300], [0, 0, 1]])
POINT = CENTRE + R.T @ (0.9, -0.6, 4.0)


def pose2sim_text() -> str:
    return (
        '[metadata]\nerror = 0.1\n\n[cam_1]\nname = "left"\nsize = [1000.0, 600.0]\n'
        f"matrix = {K.tolist()}\ndistortions = [-0.2, 0.05, 0.01, -0.02]\n"
        f"rotation = [1.2, -0.7, 0.4]\ntranslation = {T.tolist()}\nfisheye = false\n"
    )


def caliscope_text() -> str:
    return (
        "[cameras.left]\ncam_id = 0\nrotation_count = 0\nerror = 0.2\nignore = false\nsize = [1000, 600]\n"
        f"matrix = {K.tolist()}\ndistortions = [-0.2, 0.05, 0.01, -0.02, -0.1]\n"
        f"translation = {T.tolist()}\nrotation = {R.tolist()}\n"
        "\n[cameras.spare]\ncam_id = 1\nignore = true\n"
    )


def voxelpose_text() -> str:
    camera = {
        "R": R.tolist(), "T": (1000 * CENTRE)[:, None].tolist(), "fx": 900.0, "fy": 880.0, "cx": 500.0, "cy": 300.0,
        "k": [[-0.2], [0.05], [-0.1]], "p": [[0.01], [-0.02]],
    }  # fmt: skip
    return json.dumps({"left": camera})


def panoptic_text() -> str:
    """The world of the file is ours seen by someone for whom y points down and z away."""
    ours = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
    camera = {
        "name": "left", "type": "hd", "resolution": [1000, 600], "panel": 0, "node": 1, "K": K.tolist(),
        "distCoef": [-0.2, 0.05, 0.01, -0.02, -0.1], "R": (R @ ours).tolist(), "t": (100 * T)[:, None].tolist(),
    }  # fmt: skip
    return json.dumps({"calibDataSource": "x", "cameras": [camera]})


def shelf_text() -> str:
    pose = np.column_stack([R, T]).round(4)
    return json.dumps({"left": {"K": K.ravel().tolist(), "RT": pose.ravel().tolist(), "imgSize": [1000, 600]}})


def storage(**matrices) -> str:
    lines = ["%YAML:1.0", "---", "names:", '   - "left"']
    for key, value in matrices.items():
        rows, columns = np.atleast_2d(value).shape
        data = ", ".join(f"{number:.8e}" for number in np.ravel(value))
        lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
        lines += [f"   data: [ {data} ]"]
    return "\n".join(lines) + "\n"


def intrinsics_text() -> str:
    return storage(K_left=K, dist_left=[-0.2, 0.05, 0.01, -0.02, -0.1]) + "H_left: 600\nW_left: 1000\n"


def extrinsics_text() -> str:
    return storage(R_left=[[1.2], [-0.7], [0.4]], Rot_left=R.round(6), T_left=T[:, None])


def rig_text() -> str:
    return (
        "# Two notations\nname: mine\ncameras:\n  - name: left\n    size: [1000, 600]\n"
        f"    K: {K.tolist()}\n    dist: [-0.2, 5e-2, 0.01, -0.02, -0.1]\n"
        f"    cam_from_world: {[[*row, t] for row, t in zip(R.tolist(), T.tolist(), strict=True)]}\n"
    )


def opencv_text() -> str:
    text = storage(camera_matrix=K, distortion_coefficients=[-0.2, 0.05, 0.01, -0.02, -0.1], R=R, T=T[:, None])
    return text.replace('names:\n   - "left"\n', "image_width: 1000\nimage_height: 600\n")


def write_storage(path: Path, size=(1000, 600), K=K, dist=(-0.2, 0.05, 0.01, -0.02, -0.1, 0, 0, 0), R=R, t=T) -> None:
    """Write a camera by OpenCV's own writer, in the syntax that the suffix names."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", int(size[0]))
    storage.write("image_height", int(size[1]))
    storage.write("cameraMatrix", K)
    # calibrateCamera returns the rational model with six zeros at the end.
    storage.write("distCoeffs", np.pad(dist, (0, 6)))  # OpenCV 5 writes an array of one dimension
    storage.write("rvec", Rotation.from_matrix(R).as_rotvec()[:, None])
    storage.write("tvec", np.asarray(t)[:, None])
    storage.release()


TEXTS = {
    "rig": {"calibration.yaml": rig_text},
    "pose2sim": {"calib.toml": pose2sim_text},
    "voxelpose": {"calibration.json": voxelpose_text},
    "panoptic": {"calibration_x.json": panoptic_text},
    "shelf": {"calibration.json": shelf_text},
    "easymocap": {"intri.yml": intrinsics_text, "extri.yml": extrinsics_text},
    "opencv": {"left.yml": opencv_text},
    "caliscope": {"camera_array.toml": caliscope_text},
}


def write(folder: Path, format: str, **changed: str) -> Path:
    """The files of a format in a folder, some with another text."""
    for name, text in TEXTS[format].items():
        (folder / name).write_text(changed.get(name, text()))
    return folder
