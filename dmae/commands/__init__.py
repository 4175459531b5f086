"""WHAT CAN BE RUN? One module for each sub-command of `dmae`: its configuration, its examples, and `run(config,
out)`."""

COMMANDS = {
    "run": "Turn videos into people in 3D, completed, with a report",
    "detect": "Detect people in videos, or in the images of clips",
    "capture": "Turn detections into 3D poses",
    "complete": "Fill what no camera measured, marked as such",
    "evaluate": "Score methods over clips and camera subsets",
    "benchmark": "Score completion and capture on generated clips, by cause of occlusion",
    "table": "Reproduce a table of the paper, with published and measured rows",
    "stress": "Find what breaks the methods: corrupt clips step by step and score each step",
    "show": "Draw clips as contact sheet, video and Rerun recording",
    "report": "Make a page with scores and a player",
    "review": "Rank joints by their possible error, and decide on them",
    "convert": "Turn a recording into another format, or into a clip",
    "live": "Capture frames as they arrive, for other programs",
    "export": "Write poses to a file that other programs read",
    "doctor": "Find what is wrong with a calibration and its detections",
    "pretrain": "Train a model for your cameras, detector and motion: simulate, capture, train, score",
    "train-paper": "Train the paper's network, with the paper's training",
    "calibrate": "Refine a calibration by the people in a recording",
    "train": "Learn to complete poses from clips with truth",
    "demo": "Run all steps on simulated people, from simulation to report",
    "card": "Describe trained weights: training data and scores",
    "regress": "Check any triangulation against a fixed set of cases",
}
"""Each sub-command and what it does, in the order of the help; `dmae a-b` is the module `dmae.commands.a_b`."""
