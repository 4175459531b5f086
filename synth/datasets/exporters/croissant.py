"""What a publisher needs beside the files: Croissant metadata with its RAI fields, a datasheet, a citation, checksums.

Croissant 1.0 and its vocabulary for responsible AI (mlcommons.org/croissant); the datasheet has the questions of Gebru
et al. (Datasheets for Datasets, CACM 2021). All of it follows from the export and the provenance of its clips.
"""

import json
import re
from collections import Counter
from pathlib import Path

import yaml

from dmae.files.checksums import checksum
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json
from dmae.formats.labelled_images import DEPTH
from dmae.reporting.tables import counted
from synth.datasets.config import AboutConfig
from synth.datasets.statistics import PROCEDURAL, clips_by, scene_kinds, terms

TITLE = "Simulated people who hide each other"
"""Heading of the README if the publisher names none."""
CROISSANT, DATASHEET, CITATION, SUMS = "croissant.json", "DATASHEET.md", "CITATION.cff", "SHA256SUMS"

_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{
        name: f"cr:{name}"
        for name in (
            "citeAs", "column", "equivalentProperty", "extract", "field", "fileProperty", "fileObject", "fileSet",
            "format", "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet",
            "references", "regex", "repeated", "replace", "samplingRate", "separator", "source", "subField",
            "transform",
        )
    },
}  # fmt: skip
_ENCODINGS = {
    ".json": "application/json", ".jsonl": "application/jsonlines", ".tar": "application/x-tar",
    ".npz": "application/zip", ".yaml": "application/yaml",
}  # fmt: skip
_DESCRIBED = {
    "coco": "annotations/*.json", "yolo": "data.yaml", "webdataset": "*.tar", "huggingface": "*/metadata.jsonl",
    "npz": "*/*.npz", "panoptic": "*/*/calibration_*.json",
}  # fmt: skip
"""Files that the metadata lists one by one, by layout. `SHA256SUMS` lists all."""
_IMAGE_FIELDS = {
    "file_name": ("sc:Text", "file_name", {}),
    "depth_file_name": ("sc:Text", "depth_file_name", {}),
    # Croissant's reader turns a column of names like 000000 into numbers, so the name is taken from the path.
    "clip": ("sc:Text", "file_name", {"regex": "^([^/]+)/"}),
    "camera": ("sc:Text", "camera", {"jsonPath": "name"}),
    "frame": ("sc:Integer", "frame", {}),
    "bbox": ("sc:Float", "persons", {"jsonPath": "bbox"}),
    "keypoints": ("sc:Float", "persons", {"jsonPath": "keypoints"}),
    "xyz": ("sc:Float", "persons", {"jsonPath": "xyz"}),
    "visibility": ("sc:Integer", "persons", {"jsonPath": "visibility"}),
}
"""Fields of an image of the layout `huggingface`: type, column of `metadata.jsonl`, and what is taken from it."""
_ANNOTATION_FIELDS = {
    "id": "sc:Integer", "image_id": "sc:Integer", "track_id": "sc:Integer", "area": "sc:Float", "bbox": "sc:Float",
    "keypoints": "sc:Float",
}  # fmt: skip
"""Fields of an annotation of COCO. Croissant's reader takes records of one length from a file, so images have none."""
_HUB_LICENCES = {
    "creativecommons.org/publicdomain/zero/1.0": "cc0-1.0", "apache.org/licenses/license-2.0": "apache-2.0",
    "opensource.org/license/mit": "mit", "opensource.org/licenses/mit": "mit",
    "opendatacommons.org/licenses/by/1-0": "odc-by", "opendatacommons.org/licenses/odbl/1-0": "odbl",
}  # fmt: skip
"""What the Hugging Face hub calls a licence, by the end of its address."""
_LISTS = ("bbox", "keypoints", "xyz", "visibility")
_AUTHORS = "The authors of this data set"


def write_metadata(data: Path, out: Path, summary: dict, about: AboutConfig) -> None:
    """Write the four files into an export.

    Args:
        data: The data set that was exported.
        out: Folder of the export, complete but for these files.
        summary: Content of `export.json`.
        about: What only the publisher knows.
    """
    scenes: Counter[str] = Counter()
    for name in (name for split in summary["splits"].values() for name in split["names"]):
        spec = read_json(data / name / "clip.json").get("provenance", {}).get("spec")
        if spec:
            scenes.update(scene_kinds(spec))
    config = data / "config.json"
    texts = describe(summary, scenes, read_json(config).get("seed") if config.is_file() else None)
    write_atomic(out / DATASHEET, datasheet(texts, summary, about))
    write_atomic(out / CITATION, _citation(summary, about))
    files = sorted(path for path in out.rglob("*") if path.is_file())
    sums = "".join(f"{checksum(path).sha256}  {path.relative_to(out).as_posix()}\n" for path in files)
    write_atomic(out / SUMS, sums)
    write_atomic(out / CROISSANT, json.dumps(croissant(out, summary, texts, about), indent=1))


def describe(summary: dict, scenes: Counter[str], seed: int | None) -> dict[str, str]:
    """Return what is known of a data set, by the names of Croissant's RAI fields, and `rights`."""
    recorded = any(kind != PROCEDURAL for kind in clips_by(scenes, "motion"))
    rooms = ", ".join(sorted(clips_by(scenes, "arena"))) or "unknown"
    counts = {key: sum(split.get(key, 0) for split in summary["splits"].values()) for key in ("clips", "images")}
    origin = "recorded takes, replayed with contacts" if recorded else "procedural motion with published kinematics"
    return {
        "dataCollection": (
            f"Simulated by {summary['made_by']}: {counted(counts['clips'], 'clip')}, "
            f"{counted(counts['images'], 'image')}. People are "
            f"MuJoCo bodies that follow {origin}; rooms: {rooms}. The same configuration and seed"
            f"{'' if seed is None else f' ({seed})'} give the same clips."
        ),
        "dataCollectionMissingData": (
            "Joints that no camera shows are labelled as well. Clips that failed in simulation are left out and listed "
            "in manifest.jsonl of the data set, with the reason."
        ),
        "dataPreprocessingProtocol": (
            f"Joints are converted to the skeleton {summary['skeleton']}. "
            + ("Every frame is" if summary["every"] == 1 else f"One frame of {summary['every']} is")
            + " exported."
        ),
        "dataAnnotationProtocol": (
            "No human annotation. Joints are read from simulated bodies. A ray from each camera to each joint tests "
            "whether it is visible, and what hides it; masks and boxes are rendered. No trained model takes part. "
            "Simulated detections follow statistics of detectors' errors, one of them BlazePose (Google, Apache-2.0)."
        ),
        "dataUseCases": (
            "To train and test pose estimation, triangulation, tracking and completion under occlusion, with exact 3D "
            "truth. Not to be the only data of a detector for real images, and not to draw conclusions on real people."
        ),
        "dataLimitations": (
            "Images are plain renderings; faces do not move, and nobody's hands feel what they touch. "
            + (
                "People move as in the takes, as far as a simulated body can follow it."
                if recorded
                else "Procedural motion differs from recorded motion, most of all at the feet."
            )
        ),
        "dataBiases": (
            "Statures, masses and limb lengths follow published statistics (ANSUR II, NCD-RisC, growth charts of the "
            "CDC), which do not represent all populations; disabilities, aids and religious clothes do not occur."
        ),
        "dataSocialImpact": (
            "Methods that follow people behind obstacles can be used for surveillance. Synthetic people avoid "
            "recording real ones."
        ),
        "personalSensitiveInformation": (
            "No image of a real person. The motion is of recorded people, whose terms apply."
            if recorded
            else "No person was recorded."
        ),
        "dataReleaseMaintenancePlan": (
            "The data set can be made again from its configuration; errors are corrected in a new version."
        ),
        "rights": terms(scenes),
    }


def croissant(out: Path, summary: dict, texts: dict[str, str], about: AboutConfig) -> dict:
    """Return the Croissant metadata of an export."""
    files = [*sorted(out.glob(_DESCRIBED.get(summary["exporter"], "export.json"))), out / SUMS]
    objects = {path.relative_to(out).as_posix(): path for path in files}
    name = about.name or f"dmae-synth-{summary['exporter']}"
    version = f"1.0.0+{checksum(out / SUMS).sha256[:8]}"
    year = f", year={{{about.date[:4]}}}" if about.date else ""
    key = re.sub(r"[^A-Za-z0-9.:_-]+", "-", name).strip("-") or "dmae-synth"  # BibTeX ends a key at a space or comma
    stated = {
        "license": about.licence,
        "url": about.url,
        "datePublished": about.date,
        "creator": about.creator and {"@type": "sc:Organization", "name": about.creator},
    }
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": name,
        "description": f"Simulated people who hide each other from calibrated cameras. {texts['dataCollection']}\n\n"
        f"{texts['rights']}",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "version": version,
        "citeAs": f"@misc{{{key}, title={{{name}}}, author={{{about.creator or _AUTHORS}}}{year}, "
        f"note={{version {version}, made by dmae-synth}}}}",
        **{key: value for key, value in stated.items() if value},
        "isLiveDataset": False,
        "distribution": [
            {
                "@type": "cr:FileObject",
                "@id": path,
                "name": path,
                "contentUrl": path,
                "encodingFormat": _ENCODINGS.get(file.suffix, "text/plain"),
                "contentSize": f"{file.stat().st_size} B",
                "sha256": checksum(file).sha256,
            }
            for path, file in objects.items()
        ],
        "recordSet": _record_sets(out, summary),
        "rai:dataCollectionType": ["Software Collection"],
        "rai:hasSyntheticData": True,
        **{f"rai:{key}": text for key, text in texts.items() if key != "rights"},
    }


def _record_sets(out: Path, summary: dict) -> list[dict]:
    """Return the sets of records that Croissant's readers load: images, or COCO's annotations, by split."""
    found = []
    for split in summary["splits"]:
        if summary["exporter"] == "huggingface":
            file = f"{split}/metadata.jsonl"
            with (out / file).open() as lines:
                rows = map(json.loads, lines)
                first = next(rows, {})
                # Images of a clip in which nobody is seen say nothing of persons.
                persons = first.get("persons") or next((row["persons"] for row in rows if row.get("persons")), {})
            sources = {
                key: (kind, {"column": column}, transform)
                for key, (kind, column, transform) in _IMAGE_FIELDS.items()
                if transform.get("jsonPath") in persons or column not in ("persons", "depth_file_name") or key in first
            }
            found.append(_record_set(split, file, sources))
        if summary["exporter"] == "coco":
            file = f"annotations/person_keypoints_{split}.json"
            sources = {
                key: (kind, {"jsonPath": f"$.annotations[*].{key}"}, {}) for key, kind in _ANNOTATION_FIELDS.items()
            }
            found.append(_record_set(split, file, sources))
    return found


def _record_set(name: str, file: str, sources: dict[str, tuple[str, dict, dict]]) -> dict:
    """Return a set of records: of each field its type, and how it is extracted and transformed."""
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{key}",
                "name": key,
                "dataType": kind,
                **({"repeated": True} if key in _LISTS else {}),
                "source": {
                    "fileObject": {"@id": file},
                    "extract": extract,
                    **({"transform": transform} if transform else {}),
                },
            }
            for key, (kind, extract, transform) in sources.items()
        ],
    }


def hub_metadata(out: Path, summary: dict, about: AboutConfig) -> str:
    """Return the YAML at the top of a README that the Hugging Face hub reads: name, licence, tasks, size, tags.

    Args:
        out: Folder of the export, complete but for its README and metadata.
        summary: Content of `export.json`.
        about: What only the publisher knows.
    """
    images, masks = (sum(each.get(key, 0) for each in summary["splits"].values()) for key in ("images", "masks"))
    tasks = {
        "keypoint-detection": True,
        "object-detection": True,
        "image-segmentation": masks,
        "depth-estimation": any(out.rglob(f"*.{DEPTH}")),
    }
    edges = [("n<1K", 10**3), ("1K<n<10K", 10**4), ("10K<n<100K", 10**5), ("100K<n<1M", 10**6), ("1M<n<10M", 10**7)]
    content = {
        "pretty_name": about.name or TITLE,
        **_hub_licence(about.licence),
        "task_categories": [task for task, there in tasks.items() if there],
        "size_categories": [next((name for name, most in edges if images < most), "n>10M")],
        "annotations_creators": ["machine-generated"],
        "tags": ["synthetic", "human-pose-estimation", "multi-view", "occlusion", "3d", "mujoco"],
    }
    return f"---\n{yaml.safe_dump(content, sort_keys=False, allow_unicode=True)}---\n\n"


def _hub_licence(url: str | None) -> dict[str, str]:
    """Return the licence as the hub names it: by a word if it has one for this address, otherwise with the address."""
    if url is None:
        return {"license": "unknown"}
    address = url.lower().removesuffix("/").removesuffix("/legalcode").removesuffix("/deed.en").removesuffix(".txt")
    if found := re.search(r"creativecommons\.org/licenses/(by(?:-nc)?(?:-sa|-nd)?)/(\d\.\d)$", address):
        return {"license": f"cc-{found[1]}-{found[2]}"}
    for end, word in _HUB_LICENCES.items():
        if address.endswith(end):
            return {"license": word}
    return {"license": "other", "license_name": "see-link", "license_link": url}


def datasheet(texts: dict[str, str], summary: dict, about: AboutConfig) -> str:
    """Return the datasheet of an export, in Markdown."""
    splits = ", ".join(f"{name}: {counted(each['clips'], 'clip')}" for name, each in summary["splits"].items())
    sections = {
        "Motivation": texts["dataUseCases"],
        "Composition": f"{texts['dataCollection']} Splits: {splits}. {texts['dataCollectionMissingData']}",
        "Collection": f"{texts['dataAnnotationProtocol']} {texts['personalSensitiveInformation']}",
        "Preprocessing": texts["dataPreprocessingProtocol"],
        "Uses": f"{texts['dataLimitations']} {texts['dataBiases']} {texts['dataSocialImpact']}",
        "Distribution": f"Licence: {about.licence or 'not stated by the publisher'}.\n\n{texts['rights']}",
        "Maintenance": f"{texts['dataReleaseMaintenancePlan']} Contact: {about.creator or 'not stated'}.",
    }
    parts = [f"## {title}\n\n{text}" for title, text in sections.items()]
    return "\n\n".join([f"# Datasheet: {about.name or 'simulated people who hide each other'}", *parts]) + "\n"


def _citation(summary: dict, about: AboutConfig) -> str:
    stated = {"license-url": about.licence, "url": about.url, "date-released": about.date}
    fields = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it, and the software that made it.",
        "type": "dataset",
        "title": about.name or f"dmae-synth-{summary['exporter']}",
        "authors": [{"name": about.creator or _AUTHORS}],
        **{key: value for key, value in stated.items() if value},
        "references": [
            {
                "type": "software",
                "title": "dmae-synth: occluded multi-view human motion, simulated, captured and completed",
                "authors": [{"name": "The dmae-synth authors"}],
            }
        ],
    }
    return yaml.safe_dump(fields, sort_keys=False, allow_unicode=True)
