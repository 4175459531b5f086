"""How people look to one network, rendered beside photographed: silhouettes, skin and edges.

BlazePose's second network returns a mask of the person in a region, which is upright there. Both kinds of images are
searched and cut in the same way, so that faults of the masks are in both columns.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from dmae.data.rng import Stream, generator
from dmae.data.store import load_clip
from dmae.detection.detectors.blazepose import PeopleDetector
from dmae.detection.detectors.landmarks import Network, pyramid_of
from dmae.detection.images import cameras_of, find_cameras
from dmae.detection.registry import PoseDetectorConfig
from dmae.progress import progress
from dmae.reporting.tables import Table

LEVELS = {"head": 0.07, "shoulders": 0.2, "chest": 0.28, "waist": 0.4, "hips": 0.5, "knees": 0.72, "feet": 0.96}
"""Places between the top of the silhouette, 0, and its lowest point, 1, where its width is measured."""
_BAND = 0.02
"""Half of the height over which a width is averaged, relative to the silhouette's."""
_SKIN = (np.array((0, 133, 77)), np.array((255, 173, 127)))
"""Least and greatest Y, Cr and Cb of skin (Chai and Ngan, IEEE Transactions on Circuits and Systems for Video
Technology 9, 1999); wood and sand have them, too."""
_EDGES = (60, 120)
"""Thresholds of Canny's edges."""
_LEAST = 200.0
"""Least side of the region of a person, px: smaller ones are enlarged, which removes edges."""
_DRAWS = 1000


def silhouette(pixels: np.ndarray, mask: np.ndarray) -> dict[str, float] | None:
    """Return the statistics of one person; None if the border of the region cuts the silhouette off.

    Args:
        pixels: (S, S, 3) uint8 RGB; the person is upright.
        mask: (S, S) True on the person.
    """
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if len(sizes) < 2:
        return None
    mask = labels == 1 + sizes[1:, cv2.CC_STAT_AREA].argmax()
    rows = np.flatnonzero(mask.any(1))
    top, height = rows[0], rows[-1] - rows[0] + 1
    if top == 0 or rows[-1] == len(mask) - 1 or height < len(mask) / 3 or mask[:, [0, -1]].any():
        return None
    across, row = mask.sum(1) / height, (np.arange(len(mask)) - top) / height
    found = {f"width at the {name}": across[np.abs(row - at) <= _BAND].mean() for name, at in LEVELS.items()}
    found["area, of height squared"] = mask.sum() / height**2
    colours, grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2YCrCb), cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    found["skin, share of the area"] = cv2.inRange(colours, *_SKIN)[mask].mean() / 255
    # The outline is an edge of the background as well.
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    around = (cv2.dilate(mask.astype(np.uint8), np.ones((31, 31), np.uint8)) > 0) & ~mask
    edges = cv2.Canny(grey, *_EDGES) > 0
    found["edges, share of the area within"] = edges[inner].mean()
    found["edges, share around"] = edges[around].mean()
    found["brightness, 0 to 255"] = grey[mask].mean()
    found["its standard deviation"] = grey[mask].std()
    found["difference from around"] = abs(grey[mask].mean() - grey[around].mean())
    return {name: float(value) for name, value in found.items()}


def people(images: Iterable[np.ndarray]) -> Iterator[dict[str, float]]:
    """Yield the statistics of all whole people in images (H, W, 3) uint8 RGB of one camera."""
    search = PeopleDetector(PoseDetectorConfig(windows=[1.0, 0.6], search_every=1))
    network = Network("pose_landmark_full")
    for image in images:
        pyramid, size = pyramid_of(np.ascontiguousarray(image)), image.shape[1::-1]
        for person in search(image):
            region = person.region
            if region is None or region.side < _LEAST:
                continue
            # The circle around the body must be within the image, but for a tenth of its radius.
            if np.minimum(region.centre, size - region.centre).min() <= 0.9 * region.radius:
                continue
            pixels = region.cut(pyramid, network.size)
            # The logit that a pixel shows the person.
            (mask,) = network(pixels.astype(np.float32) / 255, "Identity_2")
            found = silhouette(pixels, mask[..., 0] > 0)
            if found:
                yield found


def rendered(folders: Sequence[Path], every: int) -> list[list[dict[str, float]]]:
    """Return the statistics of the people in clips with colour images, a list for each camera of a clip."""
    found = []
    for folder in progress(folders, "silhouettes", len(folders)):
        clip = load_clip(folder)
        assert clip.images is not None
        cameras = cameras_of(clip.images, clip.rig.size)
        for camera in cameras:
            images = islice(camera.read(0, len(camera)), 0, None, every)
            found.append(list(people(image for image in images if image is not None)))
    return found


def photographed(path: Path, count: int) -> list[list[dict[str, float]]]:
    """Return the statistics of the people in `count` images of each camera of a recording, a list for each camera.

    Raises as `dmae.detection.images.find_cameras`.
    """
    found, cameras = [], find_cameras(path)
    for camera in progress(cameras, "real people", len(cameras)):
        chosen = set(np.linspace(0, len(camera) - 1, min(count, len(camera))).round().astype(int).tolist())
        images = (image for i, image in enumerate(camera.read(0, len(camera))) if i in chosen)
        found.append(list(people(image for image in images if image is not None)))
    return found


def comparison(ours: list[list[dict[str, float]]], real: list[list[dict[str, float]]]) -> Table:
    """Return a table of the means of both, with intervals of 95 % from resampled cameras.

    Raises ValueError if no whole person was found in one of the two.
    """
    for what, some in (("rendered", ours), ("real", real)):
        if not any(some):
            raise ValueError(f"in no {what} image is a person whole, and larger than {_LEAST:g} px")
    rows, rng = [], generator(0, 0, Stream.VALIDATION)
    for name in next(one for some in real for one in some):
        means = [_mean([[one[name] for one in some] for some in cameras if some], rng) for cameras in (ours, real)]
        apart = means[0][1] > means[1][2] or means[1][1] > means[0][2]
        rows.append((name, *(f"{m:.3g} ({low:.3g} to {high:.3g})" for m, low, high in means), "apart" if apart else ""))
    counts = [sum(map(len, cameras)) for cameras in (ours, real)]
    return Table("Silhouettes; widths are shares of the height", ("person",
        f"{counts[0]} rendered", f"{counts[1]} real", ""), rows)  # fmt: skip


def _mean(cameras: list[list[float]], rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the mean over all people, and its interval from resampled cameras."""
    total, count = np.array([sum(each) for each in cameras]), np.array([len(each) for each in cameras])
    draws = rng.integers(len(cameras), size=(_DRAWS, len(cameras)))
    return total.sum() / count.sum(), *np.percentile(total[draws].sum(1) / count[draws].sum(1), (2.5, 97.5))
