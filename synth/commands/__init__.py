"""The sub-commands of `synth`, one module each: its configuration, its examples, and `run(config, out)`."""

COMMANDS = {
    "generate": "Simulate clips with exact truth",
    "show": "Draw clips in their rooms as contact sheet, video and Rerun recording",
    "render": "Render clips again, as other images or from other cameras",
    "label": "Add contacts, forces and points on surfaces to clips",
    "verify": "Check that clips are complete and correct",
    "split": "Divide clips for training and testing, without leaks",
    "stats": "Describe a data set: a page with a figure",
    "realism": "Measure what a real detector finds in rendered images",
    "export": "Write a data set in the layout of another program",
    "compare": "Compare the detections of a recording and of its simulation",
    "plan": "Plan how many cameras to mount, and where",
    "takes": "List takes of recorded motion, and divide them by subject",
    "compare-motion": "Compare recorded with generated motion",
    "fit-detector": "Fit a detector's preset to a recording",
    "detector-errors": "Measure errors of a detector, by cause of occlusion",
}
"""Each sub-command and its description, in the order of the help. `synth a-b` is the module `synth.commands.a_b`."""
