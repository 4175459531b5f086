"""WHAT CAN BE RUN? A file for each sub-command of `synth`: its configuration, its examples, and `run(config, out)`."""

COMMANDS = {
    "generate": "Simulate clips with exact truth",
    "show": "Draw clips in their rooms as contact sheet, video and Rerun recording",
    "render": "Render clips again, as other images or through other cameras",
    "label": "Add contacts, forces and points on surfaces to clips",
    "verify": "Check that clips are whole and true",
    "merge": "Join the parts of a data set",
    "split": "Divide clips for training and testing, without leaks",
    "stats": "Describe a data set: a page and a picture",
    "realism": "Measure what a real detector finds in rendered pictures",
    "export": "Write a data set in the layout of another program",
    "compare": "Compare the detections of a recording and of its simulation",
    "plan": "Plan how many cameras, and where to mount them",
    "takes": "List takes of recorded motion, and divide them by subject",
    "compare-motion": "Compare how recorded and how generated people move",
    "fit-detector": "Fit a detector's preset to a recording",
    "detector-errors": "Measure how a detector errs, by what hides a joint",
}
"""Each sub-command and what it does, in the order of the help; `synth a-b` is the module `synth.commands.a_b`."""
