"""Small files that ask for large machines, and things that are no files, by reader."""

import io
import lzma
import os
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.fuzz.reader import Reader
from tests.fuzz.seed_files import CUBE

ALIASES = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 40)
)
DEEP_YAML = "a: " + "[" * 20_000
DEEP_JSON = '{"a":' * 50_000
DEEP_LIST = "[" * 100_000 + "]" * 100_000
DEEP_TOML = "a = " + "[" * 20_000
DOTS_TOML = ".".join(["a"] * 20_000) + " = 1\n"
NUMBER = "9" * 100_000


def many_joints() -> str:
    """A BVH of 130 kB: 3000 joints without channels in 3000 frames of one number each would take gigabytes."""
    joints = "JOINT a\n{\nOFFSET 0 0 0\nCHANNELS 0\n}\n" * 3000
    return (
        "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 1 Xposition\n" + joints + "}\nMOTION\nFrames: 20000\n"
        "Frame Time: 0.01\n" + "0\n" * 20_000
    )  # fmt: skip


def zeros_npz(name: str) -> bytes:
    """An archive of 1 MB that unpacks to a gigabyte: a packed megabyte, 1024 times."""
    header, zeros = io.BytesIO(), bytes(1 << 20)
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**27,)})
    packer, check = zlib.compressobj(wbits=-zlib.MAX_WBITS), zlib.crc32(header.getvalue())
    begun = packer.compress(header.getvalue()) + packer.flush(zlib.Z_FULL_FLUSH)
    packed = packer.compress(zeros) + packer.flush(zlib.Z_FULL_FLUSH)
    for _ in range(1024):
        check = zlib.crc32(zeros, check)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(f"{name}.npy", begun + 1024 * packed + packer.flush())
        (entry,) = archive.filelist
        entry.compress_type, entry.CRC = zipfile.ZIP_DEFLATED, check
        entry.file_size = len(header.getvalue()) + 1024 * len(zeros)
    return buffer.getvalue()


def zeros_xz() -> bytes:
    """A compressed file of 230 kB that unpacks to a gigabyte: a packed megabyte, 1024 times. The file has no end."""
    packed = lzma.compress(bytes(1 << 20), check=lzma.CHECK_NONE)
    # A chunk states its size, less one, after 12 bytes that begin the stream, 12 that begin the block and its first 3.
    (size,) = struct.unpack_from(">H", packed, 12 + 12 + 3)
    return packed[:24] + 1024 * packed[24 : 24 + 6 + size + 1]


def stated_npz(name: str) -> bytes:
    """An archive whose array states a size that it does not have."""
    buffer, header = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**40,)})
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr(f"{name}.npy", header.getvalue())
    return buffer.getvalue()


def large_png() -> bytes:
    return b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", 100_000, 100_000) + b"\x10\0\0\0\0" + bytes(30)


def crowded(count: int) -> str:
    """One image of COCO with so many people, in a recording that spans many frames."""
    person = '{"id": 1, "image_id": 1, "category_id": 1, "keypoints": [' + ",".join(["1", "1", "2"] * 25) + "]}"
    images = ",".join(
        f'{{"id": {n}, "file_name": "cam{n % 2}/{1000 * (n // 2)}.jpg", "width": 960, "height": 600}}' for n in range(2)
    )
    more = '{"id": 9, "file_name": "cam0/1000.jpg"}'
    return f'{{"images": [{images}, {more}], "annotations": [{",".join([person] * count)}]}}'


BOMBS: dict[str, list[tuple[str, object]]] = {
    "calibration/pose2sim": [("calib.toml", DEEP_TOML), ("calib.toml", DOTS_TOML), ("calib.toml", f"a = {NUMBER}")],
    "calibration/shelf": [("calibration.json", DEEP_JSON), ("calibration.json", DEEP_LIST)],
    "calibration/easymocap": [("intri.yml", ALIASES), ("intri.yml", DEEP_YAML)],
    "recording/coco": [("keypoints.json", DEEP_LIST), ("keypoints.json", crowded(8000))],
    "recording/shelf": [("detection/0.txt", "4 1000000\n" + "1000000 " * 25), ("gt.txt", "15 1000000\n")],
    "recording/released": [
        ("camera_params.npy", lambda: _pickled(b"]" + b"".join(b"q%c(h%ch%cl" % (n, n, n) for n in range(60)) + b".")),
        ("camera_params.npy", lambda: _pickled(b"]" * 50_000 + b"a" * 49_999 + b".")),
    ],
    "poses/npz": [("poses.npz", lambda: zeros_npz("joints")), ("poses.npz", lambda: stated_npz("joints"))],
    "motion/bvh": [("take.bvh", many_joints), ("take.bvh", "HIERARCHY\n" + "ROOT a\n{\n" + "JOINT a\n{\n" * 50_000)],
    "motion/npz": [("take.npz", lambda: zeros_npz("poses")), ("take.npz", lambda: stated_npz("trans"))],
    "motion/amc": [("99.asf", lambda: _crowded_asf(5000)), ("99_01.amc", ":DEGREES\n" + "1\n" * 100_000)],
    "motion/compressed": [("take.bvh.xz", zeros_xz)],
    "motion/list": [("takes.tsv", "file\tsubject\tset\n" + '"' * 200_000), ("takes.tsv", "\t" * 200_000)],
    "motion/mapping": [("names.yaml", ALIASES), ("names.yaml", DEEP_YAML)],
    "mesh/ply": [("box.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float x\n"
                             "property float y\nproperty float z\nend_header\n")],
    "mesh/stl": [("box.stl", bytes(80) + struct.pack("<I", 2**31) + bytes(50))],
    "mesh/obj": [("box.obj", "mtllib ../../../../etc/passwd\n" + CUBE + "f 1 2 1000000000\n")],
    "room/mjcf": [
        ("room.xml", "<mujoco><worldbody>" + '<replicate count="1000" offset="1 0 0">' * 4 + '<geom size="1"/>'
                     + "</replicate>" * 4 + "</worldbody></mujoco>"),
        ("room.xml", "<mujoco>" + "<a>" * 50_000),
    ],
    "preset/generate": [("detector/mine.yaml", ALIASES), ("detector/mine.yaml", DEEP_YAML)],
    "clip/clip": [("clip.json", DEEP_JSON)],
    "images/depth": [("depth/left/000000.png", large_png)],
    "images/ids": [("ids/left/000000.png", large_png)],
    "scene/spec": [("spec.json", DEEP_JSON), ("spec.json", f'{{"seed": {NUMBER}}}')],
    "run/settings": [("config.json", DEEP_LIST)],
    "model/card": [("config.yaml", ALIASES)],
    "model/weights": [
        ("model.json", lambda text: text.replace('"depth": 1', '"depth": 2147483648', 1)),
        ("model.json", lambda text: text.replace('"mlp": 32', '"mlp": 65536', 1)),
        ("model.json", lambda text: text.replace('"dim": 16', '"dim": 2147483648', 1)),
    ],
    "scores/scores": [("scores.json", DEEP_LIST)],
}  # fmt: skip
"""File and what it holds: a text, bytes, or a function that makes them, of the text that was there or of nothing."""


def _pickled(pickled: bytes) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": "|O", "fortran_order": False, "shape": ()})
    return buffer.getvalue() + pickled


def _crowded_asf(count: int) -> str:
    bone = "begin\nid 1\nname b{0}\ndirection 1 0 0\nlength 1\naxis 0 0 0 XYZ\nend\n"
    return (
        ":root\norder TX TY TZ RX RY RZ\naxis XYZ\nposition 0 0 0\norientation 0 0 0\n:bonedata\n"
        + "".join(bone.format(n) for n in range(count))
        + ":hierarchy\nbegin\nroot " + " ".join(f"b{n}" for n in range(count)) + "\nend\n"
    )  # fmt: skip


def _pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def _circle(file: Path) -> None:
    file.unlink()
    file.symlink_to(file.name)


NO_FILES: list[Callable[[Path], object]] = [_pipe, _folder, _circle, lambda file: file.write_bytes(b"")]


def count(reader: Reader) -> int:
    """Return how many there are for a reader."""
    return len(NO_FILES) + len(BOMBS.get(reader.name, ()))


def plant(reader: Reader, folder: Path, index: int) -> Path:
    """Put one in the place of a file of the reader; return it."""
    if index < len(NO_FILES):
        file = sorted({path for pattern in reader.targets for path in folder.glob(pattern) if path.is_file()})[0]
        NO_FILES[index](file)
        return file
    name, content = BOMBS[reader.name][index - len(NO_FILES)]
    file = folder / name
    if callable(content):
        content = content(file.read_text()) if reader.name == "model/weights" else content()
    shutil.rmtree(file) if file.is_dir() else file.unlink(missing_ok=True)
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file
