"""What can be run? The commands of `synth`, in the order of the help."""

from dmae.command_line.options import Command
from dmae.data.typed import REQUIRED

COMMANDS = {
    "generate": Command(
        "Simulate clips with exact truth",
        "synth.datasets.config:GenerateConfig",
        (
            "synth generate out=runs/data clips=8 seed=7 workers=2",
            "synth generate scene=living_room rig=dome images=rgb quality=draft scene.seconds=3 out=runs/seen",
            "synth generate first=200 clips=100 workers=-1 out=runs/data",
            "synth generate clips=200 images=[rgb,depth,ids] workers=4 dry_run=true out=runs/large",
            "synth generate motion=bvh motion.path=takes occlusion.target=[0.2,0.4] out=runs/hidden",
        ),
        {
            "motion": "procedural",
            "interaction": "none",
            "scene": "office",
            "rig": "shelf",
            "detector": "shelf_openpose",
        },
    ),
    "show": Command(
        "Draw clips in their rooms as contact sheet, video and Rerun recording",
        "dmae.viewing.config:ShowConfig",
        (
            "synth show data=runs/data/000000 out=runs/show",
            "synth show data=runs/data/000000 frames=8 cameras=[0,2] width=640 rerun=true",
        ),
        {"data": REQUIRED},
    ),
    "render": Command(
        "Render clips again, as other images or from other cameras",
        "synth.datasets.config:RenderConfig",
        (
            "synth render data=runs/data images=[rgb,depth] quality=high out=runs/high",
            "synth render data=runs/data rig=ring rig.ring.views=8 images=rgb rgb=jpeg out=runs/ring",
        ),
        {"rig": None},
    ),
    "label": Command(
        "Add contacts, forces and points on surfaces to clips",
        "synth.commands.config:LabelCommand",
        ("synth label data=runs/data", "synth label data=runs/data labels=[contacts,forces] workers=2"),
        writes=None,
    ),
    "verify": Command(
        "Check that clips are complete and correct",
        "synth.commands.config:VerifyCommand",
        ("synth verify data=runs/data", "synth verify data=runs/data fast=true out=runs/verify.json"),
        writes="file",
    ),
    "split": Command(
        "Divide clips or takes for training and testing, without leaks",
        "synth.commands.config:SplitCommand",
        (
            "synth split data=runs/data by=person train=0.8 validation=0.1 test=0.1 out=runs/splits.json",
            "synth split data=runs/data by=rig check=runs/splits.json",
            "synth split data=mocap train=0.8 validation=0.1 test=0.1 out=runs/takes.tsv",
            "synth generate motion=recorded motion.path=runs/takes.tsv motion.sets=[train] out=runs/train",
        ),
        writes="file",
    ),
    "stats": Command(
        "Describe a data set: a page with a figure",
        "synth.commands.config:StatsCommand",
        ("synth stats data=runs/data", "synth stats data=runs/hug extra_data=[runs/fight,runs/dance] out=runs/card"),
    ),
    "realism": Command(
        "Measure what a real detector finds in rendered images",
        "synth.commands.config:RealismCommand",
        (
            "synth realism data=runs/data",
            "synth realism data=runs/office extra_data=[runs/market] every=5 workers=2 out=runs/realism",
        ),
    ),
    "export": Command(
        "Write a data set in the layout of another program",
        "synth.commands.config:ExportDataCommand",
        (
            "synth export data=runs/data format=coco out=runs/coco",
            "synth export data=runs/data format=yolo splits=runs/splits.json every=5 workers=4 out=runs/yolo",
            "synth export data=runs/data format=huggingface skeleton=body25 images=png out=runs/hub",
        ),
    ),
    "compare": Command(
        "Compare simulated clips with recordings: detections or motion",
        "synth.commands.config:CompareCommand",
        (
            "synth compare real=$DMAE_DATA/shelf sim=runs/twin out=runs/compare",
            "synth compare real=recording sim=runs/data frames=[0,500] limits.miss=0.05 workers=2",
            "synth compare by=motion real=takes sim=runs/data takes=[kick*,punch*] longest=5",
        ),
    ),
    "plan": Command(
        "Plan how many cameras to mount, and where",
        "synth.planning.config:PlanConfig",
        (
            "synth plan arena=room.xml views=[4,8] persons=[1,4] out=runs/plan",
            "synth plan arena=room.xml mount.walls=[2.2,2.6] mount.ceiling=false lens.view_deg=[60,90] workers=2",
            "synth plan scene=office rig=shelf views=[3,5] dry_run=true",
        ),
        {"motion": "procedural", "interaction": "none", "scene": "office", "rig": None, "detector": "shelf_openpose"},
    ),
    "fit-detector": Command(
        "Fit a detector's preset to a recording",
        "synth.commands.config:FitDetectorCommand",
        (
            "synth fit-detector detections=$DMAE_DATA/shelf scene=shelf_twin name=mine out=runs/detector",
            "synth generate --config-dir=runs/detector detector=mine out=runs/data",
            "synth fit-detector detections=runs/detected truth=annotated detector=hrnet_like name=mine "
            "out=runs/detector",
        ),
        {"motion": "procedural", "interaction": "none", "scene": "office", "detector": "shelf_openpose"},
    ),
    "detector-errors": Command(
        "Measure errors of a detector, by cause of occlusion",
        "synth.commands.config:DetectorErrorsCommand",
        (
            "synth detector-errors data=runs/detected",
            "synth detector-errors data=runs/detected simulated=[blazepose,shelf_openpose] out=runs/errors",
        ),
    ),
}
