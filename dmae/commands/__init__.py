"""WHAT CAN BE RUN? A file for each sub-command of `dmae`: its configuration, its examples, and `run(config, out)`."""

COMMANDS = {
    "run": "Turn videos into people in 3D, completed, with a report",
    "detect": "Detect people in videos, or in the images of clips",
    "capture": "Turn detections into 3D poses",
    "complete": "Fill what no camera measured, marked as such",
    "evaluate": "Score methods over clips and camera subsets",
    "benchmark": "Compare completion and capture on clips that are made here, by cause of occlusion",
    "table": "Reproduce a table of the paper, published rows beside measured ones",
    "stress": "Find what breaks the methods: corrupt clips step by step and score each step",
    "merge": "Join what was made of parts of a data set on several machines",
    "show": "Draw clips as contact sheet, video and Rerun recording",
    "report": "Put scores and pictures on one page",
    "review": "Rank joints by how far off they may be, and decide on them",
    "convert": "Turn a recording into another format, or into a clip",
    "live": "Answer frames with poses as they come, for other programs",
    "export": "Write poses to a file that other programs read",
    "doctor": "Find what is wrong with a calibration and its detections",
    "pretrain": "Make a model for your cameras, detector and motion: simulate, capture, train, score",
    "train-paper": "Train the paper's network alone, by its own recipe",
    "calibrate": "Refine a calibration by the people in a recording",
    "train": "Learn to complete poses from clips with truth",
    "demo": "Run the whole loop on simulated people, from nothing to a page",
    "card": "Describe trained weights: what they are made of and how they score",
    "regress": "Check any triangulation against a frozen pack of cases",
}
"""Each sub-command and what it does, in the order of the help; `dmae a-b` is the module `dmae.commands.a_b`."""
