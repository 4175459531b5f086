"""Record what a command measures in `docs/results/`, with the command line, versions, date and commit.

    python docs/tools/record.py             # everything in RECORDED
    python docs/tools/record.py shelf       # one of them

The command is run with `out=` in a temporary folder. The `scores.json` or `stress.json` that it writes is kept, without
its single runs. The figures of motion and of the detector on rendered images are kept, too, in `docs/images/`.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from itertools import groupby
from pathlib import Path

import cv2
from provenance import provenance

from dmae.data.json_values import json_text

ROOT = Path(__file__).parents[2]
_ALL = "measured,linear,pchip_body,kalman,reject_pchip,rays,gaussian_process,reject_gaussian_process"

_INTERACTIONS = (
    "synth generate -m interaction=fight,hug,dance,huddle rig=ring rig.ring.views=3 clips=4 seed=51 out=interactions"
)
_CAPTURED_PEOPLE = (
    "synth generate motion=recorded motion.path=$DMAE_DATA/cmu clips=56 seed=52 scene.fps=25 scene.seconds=6 "
    "'scene.persons=[2,3]' out=people && dmae capture data=people 'draw=[3,4,5]' out=captured"
)

_ROOMS = ("office", "living_room", "market", "pillars", "studio", "warehouse")
_IMAGES = "rig.ring.views=3 rig.random.views=3 images=rgb rgb=jpeg scene.fps=1"
_METER = " && ".join(
    f"synth generate -m scene={room} rig=ring,random {_IMAGES} scene.seconds=6 clips=1 seed={seed} out=meter/{room}"
    for seed, room in enumerate(_ROOMS, 81)
) + (
    f" && synth generate -m scene=office,living_room,warehouse rig=ring {_IMAGES} scene.seconds=8 clips=2 seed=87 "
    "'motion.actions=[sit,bend,crouch,lift]' out=meter/low"
)
_METER_SETS = [*(f"meter/{room}/{rig}" for room in _ROOMS for rig in (0, 1)), *(f"meter/low/{n}" for n in range(3))]
_SEEN = (
    "synth generate -m scene=office,living_room,studio,warehouse,market rig=ring,random clips=1 seed=62 "
    "scene.seconds=1.2 images=rgb out=clips && "
    "for n in 0 1 2 3 4 5 6 7 8 9; do dmae detect clip=clips/$n out=seen/$n; done"
)
_SINGLE = "detector.search_every=1 detector.windows=[1,0.6]"
_ALL_ROOMS = ",".join(_ROOMS)
_PEOPLE = f"scene={_ALL_ROOMS} rig=ring,random {_IMAGES} scene.seconds=6 workers=2"
_FIT = (
    "synth generate -m scene=office rig=ring,random clips=1 seed=62 scene.seconds=1.2 images=rgb out=followed && "
    f"synth generate -m seed=71,91 {_PEOPLE} clips=2 out=many && "
    f"synth generate -m {_PEOPLE} clips=3 seed=74 out=held && "
    "for s in followed/[01]; do dmae detect clip=$s out=seen/$s workers=2; done && "
    f"for s in many/[0-9]* held/[0-9]*; do dmae detect clip=$s out=seen/$s workers=2 {_SINGLE}; done"
)
_FITTED = ["seen/followed/1", *(f"seen/many/{n}" for n in range(24))]
_HELD_BACK = [f"seen/held/{n}" for n in range(12)]
_TOUCHING = (
    "circle_talk", "counter", "crossing", "dance", "fight", "handshake", "huddle", "hug", "pass_box", "queue",
    "shelving", "table", "walking_together",
)  # fmt: skip

RECORDED = {
    "shelf": (
        f"dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] "
        f"methods=[{_ALL},dmae,dmae_reject,dmae_denoise,dmae_online]",
        "10 minutes",
    ),
    "shelf_elsewhere": (
        "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] methods=[linear,dmae,dmae_denoise] "
        "weights=$DMAE_ELSEWHERE",
        "3 minutes, with DMAE_ELSEWHERE set to the folder of the model that `make weights-elsewhere` trains",
    ),
    "shelf_holes": (
        "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[3] reference=capture smooth=0 "
        "methods=[linear,pchip_body,rays,gaussian_process,reject_gaussian_process,dmae,dmae_reject]",
        "5 minutes",
    ),
    "shelf_paper": (
        "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] capture=paper methods=[linear]",
        "2 minutes",
    ),
    "benchmark_occlusion_v2": (
        "dmae benchmark name=occlusion-v2 size=full angles=true methods=[measured,linear,linear_body,pchip_body,kalman,"
        "rays,gaussian_process,reject_pchip,reject_gaussian_process,dmae,dmae_reject]",
        "an hour and a half",
    ),
    **{
        f"table_{number}": (
            f"{_CAPTURED_PEOPLE} && dmae table number={number} data=shelf data.path=$DMAE_DATA/shelf "
            f"extra_data=[captured]{' angles=true' * (number == 4)}",
            "half an hour, the first of them",
        )
        for number in (1, 2, 4)
    },
    "table_3": (
        f"{_INTERACTIONS} && "
        "dmae table number=3 data=interactions/0 extra_data=[interactions/1,interactions/2,interactions/3] angles=true",
        "half an hour",
    ),
    "table_6": (
        "synth generate clips=2 seed=91 rig=ring rig.ring.views=7 scene.seconds=4 'scene.persons=[3,4]' out=seven && "
        "dmae table number=6 data=seven size=small systems=[] angles=true",
        "5 minutes",
    ),
    "stress_generated": (
        "synth generate out=clips clips=2 seed=11 scene.seconds=4 scene.persons=[3,3] workers=2 && "
        "dmae stress data=clips workers=2",
        "3 minutes",
    ),
    "stress_shelf": (
        "dmae stress data=shelf data.path=$DMAE_DATA/shelf data.frames=[0,150] workers=2 pairs=[] "
        "axes=[objects,persons,misses,side_swaps,offsets,calibration,cameras] "
        "methods=[measured,linear,gaussian_process,dmae,paper]",
        "2 minutes",
    ),
    "contacts": (
        f"synth generate -m interaction={','.join(_TOUCHING)} clips=3 seed=7 scene.seconds=6 "
        f"rig=ring rig.ring.views=2 out=touching && "
        f"synth stats data=touching/0 extra_data=[{','.join(f'touching/{k}' for k in range(1, len(_TOUCHING)))}]",
        "8 minutes",
    ),
    "motion": (
        "synth generate clips=16 seed=1 rig=ring rig.ring.views=2 out=made && "
        "synth compare by=motion real=$DMAE_DATA/cmu sim=made",
        "5 minutes",
    ),
    "realism": (
        f"{_METER} && synth realism data={_METER_SETS[0]} extra_data=[{','.join(_METER_SETS[1:])}] shown=24",
        "15 minutes",
    ),
    "detector_errors": (
        f"{_SEEN} && synth detector-errors data=seen/0 extra_data=[{','.join(f'seen/{n}' for n in range(1, 10))}] "
        "simulated=[blazepose,shelf_openpose,hrnet_like]",
        "15 minutes",
    ),
    "detector_blazepose": (
        f"{_FIT} && synth fit-detector detections=seen/followed/0 extra_data=[{','.join(_FITTED)}] "
        f"held_back=[{','.join(_HELD_BACK)}] truth=annotated detector=hrnet_like rounds=10 name=blazepose",
        "30 minutes",
    ),
    "pose2sim": (
        "dmae capture data=pose2sim data.path=$DMAE_DATA/pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial",
        "half a minute",
    ),
    "regress": (
        "dmae regress solver=dmae.regression.solvers:ours && for other in dlt opencv; do "
        "dmae regress solver=dmae.regression.solvers:$other | grep -e errors -e passed; done",
        "1 minute",
    ),
}
"""Results to the commands that make them, joined by &&, and about how long that takes on two cores. What the last one
writes to its `out=` is kept."""


_IMAGES_OF = {"errors": {"errors.png": "pixels_errors.png"}, "realism": {"worst.jpg": "pixels_worst.jpg"}}
"""Figures of a result, kept in `docs/images/`."""


def record(name: str, command: str, folder: Path) -> Path:
    """Run a command and write its scores to `docs/results/<name>.json`.

    Args:
        folder: To run in, empty or as a result with the same commands before the last one left it: they are not run
            again, nor are trainings in its `out`. Tables 1, 2 and 4 share people and networks.

    Raises:
        CalledProcessError: the command failed.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    out = folder / "out"
    line = command.rpartition(" && ")[2] if out.exists() else command
    line += "" if "dmae regress" in command else f" out={out}"
    done = subprocess.run(
        line, shell=True, check=True, cwd=folder, stdout=subprocess.PIPE, text=True, env=os.environ | {"PATH": path}
    )
    data = str(Path(os.environ["DMAE_DATA"]).resolve())
    found = _found(name, out) or {"printed": done.stdout.replace(f"{folder}/", "").replace(data, "DATA")}
    made = {
        "command": command.replace("$DMAE_DATA", "DATA").replace("$DMAE_ELSEWHERE", "runs/weights/elsewhere"),
        **provenance("torch", "mujoco"),
        **found,
    }
    file = ROOT / "docs/results" / f"{name}.json"
    file.write_text(json_text(made) + "\n")
    return file


def _found(name: str, out: Path) -> dict:
    """Return the result that a command wrote into its folder: a table of the paper, a stress test, or scores."""
    if name.startswith("table_"):
        return {"table": json.loads((out / f"{name}.json").read_text())}
    if (out / "stress.json").is_file():
        return {"stress": json.loads((out / "stress.json").read_text())}
    if (out / "statistics.json").is_file():
        return {"contacts": json.loads((out / "statistics.json").read_text())["contacts"]}
    for name in ("realism", "errors", "distances"):
        if (out / f"{name}.json").is_file():
            for image, kept in _IMAGES_OF.get(name, {}).items():
                shutil.copyfile(out / image, ROOT / "docs/images" / kept)
            return json.loads((out / f"{name}.json").read_text())
    if (out / "motion.json").is_file():
        image = cv2.imread(str(out / "motion.png"))
        cv2.imwrite(str(ROOT / "docs/images/motion.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 85])
        return {"differences": json.loads((out / "motion.json").read_text())["differences"]}
    scores = out / "scores.json"
    return {"scores": _less_runs(json.loads(scores.read_text()))} if scores.is_file() else {}


def _less_runs(scores: dict) -> dict:
    for result in scores.get("results", []):
        result.pop("runs", None)
    scores.pop("clips", None)
    for task in ("completion", "capture"):
        for entry in scores.get(task, {}).values():
            entry.pop("clips")
    return scores


if __name__ == "__main__":
    if not os.environ.get("DMAE_DATA"):
        sys.exit("set DMAE_DATA to the folder that holds shelf/")
    names = sys.argv[1:] or RECORDED
    if unknown := [name for name in names if name not in RECORDED]:
        sys.exit(f"no results {unknown[0]!r}; there are {', '.join(RECORDED)}")
    for _, group in groupby(names, lambda name: RECORDED[name][0].rpartition(" && ")[0] or name):
        with tempfile.TemporaryDirectory() as folder:
            for name in group:
                text, duration = RECORDED[name]
                print(f"{name}, about {duration}: {text}", flush=True)
                print(record(name, text, Path(folder)), flush=True)
