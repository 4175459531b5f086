"""BlazePose: people are searched in windows, then followed from image to image in regions of their own."""

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.blazepose.confidence import confidence
from dmae.detection.blazepose.landmarks import Person
from dmae.detection.blazepose.people import PeopleDetector
from dmae.detection.blazepose.torso import corrected_torso
from dmae.detection.registry import PoseDetectorConfig, pose_detector


@pose_detector("blazepose")
def blazepose(config: PoseDetectorConfig) -> "BlazePose":
    """MediaPipe's BlazePose, which comes with the package: 33 joints, several people, about 20 ms for each."""
    return BlazePose(config)


class BlazePose:
    """A `PictureDetector`."""

    skeleton = BLAZEPOSE33

    def __init__(self, config: PoseDetectorConfig):
        self._people, self._size = PeopleDetector(config, look_back=True), (0, 0)

    def __call__(self, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._size = picture.shape[:2]
        return self._joints_of(self._people(picture))

    def found_late(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Return earlier images in which people were found by the last image; see `PictureDetector`."""
        return [(ago, *self._joints_of(people)) for ago, people in self._people.late]

    def find_at(self, picture: np.ndarray, expected: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the people at expected places; see `PictureDetector`."""
        self._size = picture.shape[:2]
        return self._joints_of(self._people.expected(picture, expected, known))

    def _joints_of(self, people: list[Person]) -> tuple[np.ndarray, np.ndarray]:
        if not people:
            return np.empty((0, len(self.skeleton), 2)), np.empty((0, len(self.skeleton)))
        xy = corrected_torso(np.stack([person.xy for person in people]))
        score = np.stack([confidence(person) for person in people])
        # A joint outside of the image was not seen: its place is a guess.
        height, width = self._size
        inside = ((xy >= -0.5) & (xy <= (width - 0.5, height - 0.5))).all(-1)
        return np.where(inside[..., None], xy, np.nan), np.where(inside, score, np.nan)
