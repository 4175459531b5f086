"""What can be run? The commands of `dmae`, in the order of the help."""

from dmae.command_line.options import Command
from dmae.data.typed import REQUIRED

COMMANDS = {
    "run": Command(
        "Turn videos into people in 3D, completed, with a report",
        "dmae.commands.config:RunCommand",
        (
            "dmae run videos=session/videos calibration=session/calibration.toml out=runs/session",
            "dmae run videos=session/videos calibration=session/calibration.toml export=[trc,c3d] workers=4 "
            "out=runs/session",
        ),
        {"capture": "default"},
    ),
    "detect": Command(
        "Detect people in videos, or in the images of clips",
        "dmae.commands.config:DetectCommand",
        (
            "dmae detect videos=session/videos calibration=session/calibration.toml out=runs/detected",
            "dmae detect clip=runs/data out=runs/detected workers=2",
            "dmae detect videos=session/videos output.format=coco out=runs/keypoints",
            "dmae detect photos=photographs out=runs/keypoints",
        ),
    ),
    "capture": Command(
        "Turn detections into 3D poses",
        "dmae.commands.config:CaptureCommand",
        (
            "dmae capture data=runs/data out=runs/captured",
            "dmae capture data=runs/data first=100 clips=100 workers=-1 out=runs/captured",
            "dmae capture data=shelf data.path=$DMAE_DATA/shelf out=runs/shelf",
            "dmae capture data=openpose data.path=session data.fps=60 fill=linear smooth=0.1 out=runs/session",
        ),
        {"data": REQUIRED, "capture": "default"},
    ),
    "complete": Command(
        "Fill joints on which fewer than two cameras agree, marked as such; smooth the others",
        "dmae.commands.config:CompleteCommand",
        (
            "dmae complete clip=runs/captured out=runs/completed",
            "dmae complete clip=runs/captured weights=runs/model out=runs/completed",
            "dmae complete clip=runs/captured workers=-1 dry_run=true",
            "dmae complete clip=runs/captured reject=false denoise=false smooth=0 out=runs/filled",
            "dmae complete clip=runs/captured online=true delay=0.2 out=runs/online",
        ),
    ),
    "evaluate": Command(
        "Score methods over clips and camera subsets",
        "dmae.evaluation.config:EvaluateConfig",
        (
            "dmae evaluate data=runs/test methods=[measured,linear,dmae] out=runs/scores",
            "dmae evaluate data=runs/test methods=[linear,dmae] workers=-1 dry_run=true",
            "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] out=runs/scores_shelf",
            "dmae evaluate data=runs/test poses=predictions out=runs/scores_mine",
            "dmae evaluate data=runs/test baseline=runs/scores out=runs/scores_now",
        ),
        {"data": REQUIRED, "capture": "default"},
    ),
    "benchmark": Command(
        "Score completion and capture on generated clips, by cause of occlusion",
        "dmae.evaluation.config:BenchmarkConfig",
        (
            "dmae benchmark methods=[linear,dmae,my_module:fill] workers=2 out=runs/benchmark",
            "dmae benchmark methods=[runs/filled] against=runs/benchmark data_folder=runs/benchmark/data out=runs/mine",
        ),
    ),
    "table": Command(
        "Reproduce a table of the paper, with published and measured rows",
        "dmae.evaluation.config:TableConfig",
        (
            "dmae table number=1 data=shelf data.path=$DMAE_DATA/shelf out=runs/table",
            "dmae table number=2 data=shelf data.path=$DMAE_DATA/shelf protocol=4da size=small out=runs/table",
            "dmae table number=3 data=runs/interactions/0 extra_data=[runs/interactions/1,runs/interactions/2] "
            "out=runs/table",
        ),
        {"data": REQUIRED, "capture": "default"},
    ),
    "stress": Command(
        "Find what breaks the methods: corrupt clips step by step and score each step",
        "dmae.evaluation.config:StressConfig",
        (
            "dmae stress data=runs/test out=runs/stress workers=2",
            "dmae stress data=runs/test axes=[objects,jitter] levels.jitter=[1,2,4] methods=[linear,dmae] "
            "out=runs/stress",
            "dmae stress data=shelf data.path=$DMAE_DATA/shelf size=full workers=-1 out=runs/stress_shelf",
        ),
        {"data": REQUIRED, "capture": "default"},
    ),
    "show": Command(
        "Draw clips as contact sheet, video and Rerun recording",
        "dmae.viewing.config:ShowConfig",
        (
            "dmae show data=runs/completed out=runs/show",
            "dmae show data=openpose data.path=recordings/walk data.fps=30 layers.detections=true",
            "dmae show data=runs/completed/000000 layers.truth=true layers.measured=false rerun=true",
        ),
        {"data": REQUIRED},
    ),
    "report": Command(
        "Make a page with scores and a player",
        "dmae.commands.config:ReportCommand",
        (
            "dmae report clip=runs/completed",
            "dmae report scores=[runs/scores,runs/scores_shelf] clip=runs/completed out=runs/report.html",
        ),
        writes="file",
    ),
    "review": Command(
        "Rank joints by their possible error, and decide on them",
        "dmae.commands.config:ReviewCommand",
        ("dmae review clip=runs/completed", "dmae review clip=runs/completed blank=[1,4] hand_back=[2] accept=[3]"),
        writes="file",
    ),
    "convert": Command(
        "Turn a recording into another format, or into a clip",
        "dmae.commands.config:ConvertCommand",
        (
            "dmae convert data=pose2sim data.path=session/trial out=runs/session",
            "dmae convert data=runs/data format=openpose out=runs/openpose",
        ),
        {"data": REQUIRED},
    ),
    "live": Command(
        "Capture frames as they arrive, for other programs",
        "dmae.commands.config:LiveCommand",
        (
            "dmae live calibration=rig.toml fps=25 < frames.jsonl > poses.jsonl",
            "dmae live calibration=rig.toml fps=25 complete=true listen=127.0.0.1:5555",
        ),
        {"capture": "default"},
        writes=None,
    ),
    "export": Command(
        "Write poses to a file that other programs read",
        "dmae.commands.config:ExportCommand",
        (
            "dmae export clip=runs/completed out=runs/completed/poses.npz",
            "dmae export clip=runs/completed format=trc unit=mm out=runs/walk.trc",
            "dmae export clip=runs/completed keep_mm=30 out=runs/completed/sure.npz",
            "dmae export clip=runs/data/000000 format=coco out=runs/keypoints.json",
        ),
        writes=None,
    ),
    "doctor": Command(
        "Find what is wrong with a calibration and its detections",
        "dmae.commands.config:DoctorCommand",
        (
            "dmae doctor data=pose2sim data.path=session/trial",
            "dmae doctor data=openpose data.path=session data.fps=60 max_offset=100 out=runs/doctor",
        ),
        {"data": REQUIRED},
    ),
    "pretrain": Command(
        "Train a model for your cameras, detector and motion: simulate, capture, train, score",
        "dmae.commands.config:PretrainCommand",
        (
            "dmae pretrain out=runs/own",
            "dmae pretrain motion=mocap rig=session/calibration detector=hrnet_like clips=200 out=runs/own",
            "dmae pretrain motion=runs/takes.tsv rig=ring views=[2,3,4] steps=20000 workers=4 out=runs/own",
        ),
    ),
    "calibrate": Command(
        "Refine a calibration by the people in a recording",
        "dmae.commands.config:CalibrateCommand",
        (
            "dmae calibrate data=pose2sim data.path=session/trial out=runs/rig.toml",
            "dmae calibrate data=openpose data.path=session refine.cameras=[all] refine.focal=true out=runs/rig.toml",
            "dmae calibrate data=pose2sim data.path=session/trial refine.extrinsics=false refine.level=true "
            "out=runs/rig.toml",
            "dmae calibrate data=runs/data/000000 refine.offsets=true refine.drift=true out=runs/rig.toml",
        ),
        {"data": REQUIRED},
        writes="file",
    ),
    "train": Command(
        "Learn to complete poses from clips with truth",
        "dmae.completion.config:TrainConfig",
        (
            "dmae train data=runs/captured out=runs/model max_minutes=5",
            "dmae train data=runs/captured validation_data=[runs/held_back] learning.steps=20000 out=runs/model",
            "dmae train -m data=runs/clips model=paper model.codes.no_joint=true,false out=runs/ablation",
        ),
        {"data": REQUIRED, "capture": "default", "model": "default"},
    ),
    "demo": Command(
        "Run all steps on simulated people, from simulation to report",
        "dmae.commands.config:DemoCommand",
        ("dmae demo", "dmae demo size=full shelf=recordings/shelf workers=4"),
    ),
    "regress": Command(
        "Check any triangulation against a fixed set of cases",
        "dmae.commands.config:RegressCommand",
        (
            "dmae regress solver=dmae.regression.solvers:ours",
            "dmae regress solver=my_module:triangulate skip=[] report=runs/regress.html",
        ),
        writes=None,
    ),
}
