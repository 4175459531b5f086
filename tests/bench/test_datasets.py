"""Time to read windows and images, compared with reading their bytes, and the memory that it needs."""

import os
from pathlib import Path

import av
import numpy as np
import pytest

from dmae.data.store import save_clip, write_manifest
from dmae.datasets import FrameDataset, WindowDataset
from tests.support.clips import full_clip
from tests.support.data_sets import image_set
from tests.support.timing import seconds

pytestmark = pytest.mark.bench

CLIPS, FRAMES = 40, 100


@pytest.fixture(scope="module")
def clips(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("bench") / "set"
    clip = full_clip(FRAMES)
    for number in range(CLIPS):
        save_clip(clip, out / f"{number:06d}")
    write_manifest(out, [{"id": f"{number:06d}", "status": "ok"} for number in range(CLIPS)])
    return out


def test_windows_in_random_order(clips):
    """Beside reading the bytes of the same frames, of all arrays, from the files."""
    windows = WindowDataset(clips, frames=30, every=15)
    order = np.random.default_rng(0).permutation(len(windows))[:200].tolist()
    files = [file.folder / "arrays.safetensors" for file in windows.files]
    share = 30 / FRAMES

    def plain() -> None:
        for index in order:
            clip, _, start = windows.place(index)
            with files[clip].open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                file.seek(int(size * start / FRAMES))
                file.read(int(size * share))

    whole, least = seconds(lambda: [windows[index] for index in order]), seconds(plain)
    print(f"\nwindows of 30 frames: {len(order) / whole:.0f} a second, {whole / least:.1f} x reading their bytes")


def test_images_in_random_order_and_in_a_row(tmp_path):
    """Beside decoding the same frames of the videos in a row, which is the least that a video costs."""
    frames = FrameDataset(image_set(tmp_path / "set", clips=4, frames=50))
    videos = [file.folder / "images/rgb" / f"{name}.mp4" for file in frames.files for name in file.cameras]

    def plain() -> None:
        for path in videos:
            with av.open(str(path)) as container:
                container.streams.video[0].codec_context.thread_count = 1
                for frame in container.decode(video=0):
                    frame.to_ndarray(format="rgb24")

    order = np.random.default_rng(0).permutation(len(frames)).tolist()
    least = seconds(plain)
    for name, indices in (("in a row", range(len(frames))), ("in random order", order)):
        spent = seconds(lambda indices=indices: [frames[index] for index in indices])
        print(f"\nimages {name}: {len(order) / spent:.0f} a second, {spent / least:.1f} x decoding the videos")


def test_memory_stays_flat(clips):
    """Windows of all clips, twice: what a process holds does not grow with the data."""
    if not Path("/proc/self/statm").is_file():
        pytest.skip("memory is read from /proc")
    windows, held = WindowDataset(clips, frames=30, every=15), []
    for _ in range(4):
        for index in range(0, len(windows), 3):
            windows[index]
        # Private memory: pages of the files that are mapped are the system's to drop.
        resident, shared = map(int, Path("/proc/self/statm").read_text().split()[1:3])
        held.append((resident - shared) * os.sysconf("SC_PAGE_SIZE"))
    print(f"\n{[f'{each / 2**20:.0f}' for each in held]} MiB after each pass")
    assert held[-1] < 1.05 * held[0]
