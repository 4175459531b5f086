"""The registries of formats: readers of recordings and of poses, writers of poses and of recordings.

To add a format, write its functions into a file of this folder under the decorators `reader`, `pose_reader`,
`pose_writer` and `recording_writer` (`dmae.registry`).
"""

from dataclasses import dataclass, field
from importlib.util import find_spec

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class RecordingReader(Entry):
    """A reader of recordings: a function that takes a path and the options that it needs, and returns a `Clip`.

    Options are `calibration` (a `CalibrationSource`: its path, and values that its file does not state), `detections`
    (their folder or file, if not found in the path), `fps` (if not stated by the files) and `skeleton`, of detections.
    A reader that is not of `cameras` returns `NumberedDetections`: `dmae.formats.reading` adds calibration and frame
    rate, and gives it the path of the detections if it takes no `detections`. Readers raise FileNotFoundError if files
    are missing, and ValueError if they are malformed or do not fit together.
    """

    # Lists of file patterns. A folder is recognised if it contains a match of every pattern of one list.
    signs: list[list[str]] = field(default_factory=list)
    file: str = ""  # Pattern of the names of files that are recognised
    # Other formats contain these files too, so this format is recognised only if no other format is
    general: bool = False
    data_set: bool = False  # The path can be a data set: a folder that contains one folder per clip
    cameras: bool = True  # The reader returns a clip, with its cameras; otherwise it returns detections

    def takes(self, option: str) -> bool:
        """Return whether recordings of this format take an option: `calibration`, `detections`, `fps`, `skeleton`."""
        return option in self.options or not self.cameras


@dataclass(frozen=True)
class PoseReader(Entry):
    """A reader of poses: a function that takes a path and returns a `dmae.formats.poses.PoseFile`."""

    file: str = ""  # Pattern of the names of files that it reads; empty if it reads folders
    # File patterns. The reader reads a folder if the folder contains a match of one of them.
    signs: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class PoseWriter(Entry):
    """A writer of poses: a function that takes poses, their clip, and the path to write.

    It returns the files that it wrote, or None if that is the path alone.
    """

    folder: bool = False  # The writer writes a folder, not a file
    skeleton: str | None = None  # Name of the only skeleton that the format supports; None if it supports any
    table: bool = False  # The format cannot say how each joint is known, so `<name>.provenance.csv` says it
    errors: bool = False  # The format states the errors of joints, or of angles
    # The format cannot say that a joint is absent, so joints are filled: in the frames of the person's "stay", from the
    # first to the last in which it is known, or in "all" frames of the clip, where the format states no times
    fills: str = ""
    rigs: list[str] = field(default_factory=list)  # Names of skeletons of other programs that the format has besides
    # If the skeleton is fused from several, all joints are written by default. Otherwise only the joints of the first
    # skeleton are written.
    fused: bool = False
    needs: list[str] = field(default_factory=list)  # Modules that it imports, which may not be installed
    extra: str = ""  # Extra of the package that installs them; otherwise they have their own names

    def check_installed(self) -> None:
        """Raise ValueError if a module that the writer needs is not installed."""
        if missing := [name for name in self.needs if find_spec(name) is None]:
            install = f"'dmae-synth[{self.extra}]'" if self.extra else " ".join(missing)
            raise ValueError(f"format={self.name} needs {' and '.join(missing)}: pip install {install}")


@dataclass(frozen=True)
class RecordingWriter(Entry):
    """A writer of recordings: a function that takes a clip and the folder to write."""

    # Options that the format cannot store, so that the user has to give them to the reader
    lacks: list[str] = field(default_factory=list)


reader = Registry("reader", RecordingReader, __package__, option="data", returns=("Clip", "NumberedDetections"))
pose_reader = Registry("pose_reader", PoseReader, __package__)
pose_writer = Registry("pose_writer", PoseWriter, __package__, option="format")
recording_writer = Registry("recording_writer", RecordingWriter, __package__, option="format")
