"""The registries of formats: readers of recordings and of poses, writers of poses and of recordings.

To add a format, write its functions into a file of this folder under the decorators `reader`, `pose_reader`,
`pose_writer` and `recording_writer` (`dmae.registry`).
"""

from dataclasses import dataclass, field

from dmae.registry import Entry, Registry


@dataclass(frozen=True)
class RecordingReader(Entry):
    """A function of the path of a recording, and of the options that it needs, that returns a `Clip`.

    For the options see `dmae.formats.reading`.

    Attributes:
        signs: Lists of patterns; a folder is recognised where all patterns of one of the lists are found in it.
        file: Pattern of the names of files that are recognised.
        general: Other formats contain such files too, so that this one is recognised only where no other is.
        data_set: A path can hold clips in folders of their own.
    """

    signs: list[list[str]] = field(default_factory=list)
    file: str = ""
    general: bool = False
    data_set: bool = False


@dataclass(frozen=True)
class PoseReader(Entry):
    """A function of the path of poses that returns a `dmae.formats.recordings.pose_files.PoseFile`.

    Attributes:
        file: Pattern of the names of files that it reads; empty where it reads folders.
        signs: Patterns; a folder is read where one of them is found in it.
    """

    file: str = ""
    signs: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class PoseWriter(Entry):
    """A function of poses, the clip that they are of, and the path to write.

    Attributes:
        folder: It writes a folder.
        skeleton: The only skeleton of the format.
        fused: Of fused skeletons all joints are written by default, not only those of the first.
    """

    folder: bool = False
    skeleton: str | None = None
    fused: bool = False


@dataclass(frozen=True)
class RecordingWriter(Entry):
    """A function of a clip and the folder to write.

    Attributes:
        lacks: Options that the format does not hold, so that a reader has to be given them.
    """

    lacks: list[str] = field(default_factory=list)


_TRACKERS, _MOTION_CAPTURE = f"{__package__}.trackers", f"{__package__}.motion_capture"
reader = Registry("reader", RecordingReader, __package__, _TRACKERS, option="data")
pose_reader = Registry("pose_reader", PoseReader, __package__, _MOTION_CAPTURE, _TRACKERS)
pose_writer = Registry("pose_writer", PoseWriter, __package__, _MOTION_CAPTURE, _TRACKERS, option="format")
recording_writer = Registry("recording_writer", RecordingWriter, __package__, option="format")
