"""Small data sets on disk."""

from dataclasses import replace
from pathlib import Path

from dmae.data.store import save_clip, write_manifest
from tests.support.clips import image_clip


def image_set(out: Path, clips: int = 3, frames: int = 3, depth: bool = False) -> Path:
    """A data set of clips with images of two small cameras.

    Its scenes are of people a and b, b and c, d and e, ..., who follow a take each.
    """
    bodies = [("a", "b"), ("b", "c"), ("d", "e"), ("f", "g"), ("h", "i"), ("j", "k")]
    for number, people in enumerate(bodies[:clips]):
        name = f"{number:06d}"
        clip = image_clip(out / name / "images", frames, depth=depth)
        persons = [
            {
                "body": {"stature": 1.5 + ord(each) / 1000},
                "motion": f"0{number}_0{place} (cmu, 120 fps) {number}.00-{number + 1}.00 s",
            }
            for place, each in enumerate(people)
        ]
        spec = {"seed": 3, "arena": "studio", "clip": number, "motion": {"kind": "bvh"}, "persons": persons}
        save_clip(replace(clip, id=name, provenance={"first_frame": 5, "spec": spec}), out / name)
    write_manifest(out, [{"id": f"{n:06d}", "status": "ok", "frames": frames, "persons": 2} for n in range(clips)])
    return out
