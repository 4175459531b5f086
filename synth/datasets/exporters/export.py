"""Export data sets: choose clips, check them, and write them in the layout of another program."""

import json
import shutil
from collections import Counter
from importlib import metadata
from pathlib import Path

from dmae.data.skeleton import Skeleton, option_skeleton
from dmae.data.store import clip_folders
from dmae.data.typed import check_arguments
from dmae.files.checksums import refuse_damaged
from dmae.files.contents import check_vacant, whole_folder, write_atomic
from dmae.files.structured import read_json
from dmae.parallel import check_workers
from dmae.reporting.tables import counted, markdown_table
from synth.datasets.config import AboutConfig, ImageFormat
from synth.datasets.exporters import Exporter, exporter
from synth.datasets.exporters.croissant import TITLE, hub_metadata, write_metadata
from synth.datasets.exporters.selection import PARTS, Selection
from synth.datasets.splits import read_splits
from synth.labels.physical_labels import FILE as PHYSICS
from synth.labels.surfaces import NAMES

FORMAT = 1
SUMMARY = "export.json"
CARD = "README.md"
ONE_SPLIT = "train"
"""The split of all clips if no splits are given."""


@check_arguments
def export(
    path: str | Path,
    out: str | Path,
    format: str = "coco",
    *,
    splits: str | Path | None = None,
    skeleton: str | None = None,
    every: int = 1,
    images: str = "jpg",
    workers: int = 1,
    damaged: bool = False,
    robot: str | None = None,
    about: AboutConfig | None = None,
) -> dict:
    """Write a data set in the layout of another program: images and annotations, with Croissant metadata.

    Args:
        path: The data set, or a clip.
        out: Folder to write, whole or not at all; it must be empty or not exist.
        format: `coco`, `yolo`, `webdataset`, `huggingface`, `panoptic`, `npz`, `g1`, `lerobot`, `glb` or `usd`.
            The last six need no images.
        splits: File that `split` wrote; by default all clips are in the split `train`.
        skeleton: Skeleton of the joints; by default coco17, for panoptic always panoptic19.
        every: Number of frames from one image to the next; 2 for every other frame.
        images: `jpg` or `png`.
        workers: Processes; -1 for one per core.
        damaged: Whether to export even if files are missing or have changed.
        robot: MJCF of the Unitree G1, for `g1` and `lerobot`; by default from an installed mjlab.
        about: Name, publisher and licence, for `croissant.json`, `DATASHEET.md` and `CITATION.cff`.

    Returns:
        A description of the export, as in `export.json`.

    Raises:
        FileNotFoundError: the data set or the file of splits does not exist.
        ValueError: `out` is not empty, clips have no truth, no images or different skeletons, files are damaged, the
            splits do not match the clips, or an option is invalid.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=1, seed=7, out="walks"): pass
        >>> synth.export("walks", "panoptic", "panoptic")["skeleton"]
        'panoptic19'
    """
    data, out, about = Path(path), Path(out), about or AboutConfig()
    entry = exporter.find(format)
    if images not in ImageFormat.__members__:
        raise ValueError(f"images={images!r}: expected one of {', '.join(ImageFormat.__members__)}")
    if every < 1:
        raise ValueError(f"every: expected 1 or more frames, found {every}")
    check_workers(workers)
    folders = clip_folders(data)
    if not damaged:
        refuse_damaged(data, "damaged=true")
    if (data / "clip.json").is_file():
        data = data.parent
    check_vacant(out, "the exported data set")
    names = [folder.name for folder in folders]
    chosen = {ONE_SPLIT: names} if splits is None else read_splits(Path(splits), names)
    missing = {"train", "validation"} - set(chosen)
    if entry.validation and missing:
        raise ValueError(
            f"format={entry.name}: its readers insist on the splits train and validation, and there is no "
            f"{' and no '.join(sorted(missing))}; make them by synth split, and give splits=..."
        )
    used = [folder for folder in folders if any(folder.name in each for each in chosen.values())]
    selection = Selection(data, chosen, _skeleton(entry, used, skeleton), every, images, workers, robot)
    with whole_folder(out) as partial:
        found = entry.function(selection, partial)
        shutil.rmtree(partial / PARTS, ignore_errors=True)
        summary = _summary(entry, selection, found, len(names))
        write_atomic(partial / SUMMARY, json.dumps(summary, indent=1))
        hub = hub_metadata(partial, summary, about) if entry.name == "huggingface" else ""
        write_atomic(partial / CARD, hub + card(summary, entry.images, about.name or TITLE))
        write_metadata(data, partial, summary, about)
    return summary


_COUNTED = {
    "clips": "clips", "images": "images", "persons": "persons", "hidden": "persons hidden", "masks": "masks",
    "amodal_masks": "amodal masks", "pixel_boxes": "boxes of visible pixels",
}  # fmt: skip
"""What layouts count, and how their README calls it."""


def _skeleton(entry: Exporter, folders: list[Path], wanted: str | None) -> Skeleton:
    """Check that the clips can be exported together; return the skeleton to write."""
    found: dict[str, str] = {}
    for folder in folders:
        meta = read_json(folder / "clip.json")
        truth = meta.get("skeletons", {}).get("truth")
        if truth is None:
            raise ValueError(f"{folder}: the clip has no truth, which exports of data sets are made of")
        found.setdefault(truth, folder.name)
        kinds = (meta.get("images") or {}).get("kinds", ())
        if entry.images and "rgb" not in kinds:
            raise ValueError(
                f"{folder}: format={entry.name} needs images, and the clip has images of "
                f"{', '.join(kinds) or 'no kind'}; "
                "synth render data=... images=rgb out=... makes them (images=all for masks and true "
                "boxes, too)"
            )
    if len(found) > 1:
        listed = " and ".join(f"{skeleton} (clip {name})" for skeleton, name in found.items())
        raise ValueError(f"expected clips with truth of one skeleton, found {listed}; export them apart")
    if entry.only and wanted not in (None, entry.skeleton):
        raise ValueError(f"skeleton={wanted}: format={entry.name} is always of {entry.skeleton}; leave it out")
    return option_skeleton("skeleton", wanted or entry.skeleton)


def _summary(entry: Exporter, selection: Selection, found: dict[str, Counter], clips: int) -> dict:
    skeleton = selection.skeleton
    points = any((selection.data / name / PHYSICS).is_file() for names in selection.splits.values() for name in names)
    return {
        "format": FORMAT,
        "exporter": entry.name,
        "made_by": f"dmae-synth {metadata.version('dmae-synth')}",
        "skeleton": skeleton.name,
        "joints": list(skeleton.joints),
        "every": selection.every,
        "clips_of_the_data_set": clips,
        **({"surface_points": list(NAMES)} if points else {}),
        "splits": {split: {**counts, "names": selection.splits[split]} for split, counts in found.items()},
    }


def card(summary: dict, annotated: bool, title: str) -> str:
    """Return the text of the README of an export, in Markdown.

    Args:
        summary: Content of `export.json`.
        annotated: Whether the layout has a box and the joints of each person in each image.
        title: Its heading.
    """
    splits = summary["splits"]
    total = sum((Counter({key: each[key] for key in _COUNTED if key in each}) for each in splits.values()), Counter())
    columns = [key for key in _COUNTED if key != "pixel_boxes" and (total[key] or key in ("clips", "images"))]
    header = ["split", *(_COUNTED[key] for key in columns)]
    rows = [(name, *(str(each.get(key, 0)) for key in columns)) for name, each in splits.items()]
    frames = "every frame" if summary["every"] == 1 else f"one frame of {summary['every']}"
    notes = _notes(total, summary["clips_of_the_data_set"] - total["clips"], annotated)
    lines = "\n".join(f"- {note}" for note in notes)
    return f"""# {title}

Exported by {summary["made_by"]} as `{summary["exporter"]}`, version {summary["format"]} of its layout
(`docs/reference/exports.md` of the project). Skeleton `{summary["skeleton"]}`, {frames} of the clips.

{markdown_table(header, rows)}

{lines}
"""


def _notes(total: Counter, left_out: int, annotated: bool) -> list[str]:
    notes = []
    if left_out:
        notes.append(f"{counted(left_out, 'clip')} of the data set in no split: left out.")
    if not total["images"]:
        notes.append("There are no images.")
    if not annotated:
        return notes
    notes.append("Joints have v = 2 where they are visible, 1 where they are in the image and hidden, else 0.")
    if total["hidden"]:
        notes.append(f"{total['hidden']} times a person is in the image and nothing of them shows; they are left out.")
    persons, boxes = total["persons"], total["pixel_boxes"]
    if boxes < persons:
        notes.append(
            f"{boxes} of {persons} boxes are of visible pixels. For the others there are no images of ids: they are of "
            "the joints in the image (`bbox_of`), and these persons have no masks."
        )
    else:
        notes.append("Boxes are of the visible pixels.")
    if 0 < total["amodal_masks"] < persons:
        notes.append(f"{total['amodal_masks']} of {persons} persons have amodal masks.")
    return notes
