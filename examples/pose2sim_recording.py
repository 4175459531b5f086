"""A real recording to completed 3D: Pose2Sim's demo session, four cameras, one person balancing on a beam.

The folder is read as Pose2Sim wrote it. Its cameras disagree by centimetres; what a pixel of each camera is
worth is learned from the recording. A second person, whom two cameras show, stands and watches:
`capture(..., dmae.CaptureConfig(persons=1))` leaves her out.
"""

import os
import sys
from pathlib import Path

import numpy as np

import dmae

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
session = Path(os.environ.get("DMAE_DATA", "."), "pose2sim/S00_P00_SingleParticipant")
if not session.is_dir():
    sys.exit(f"skipped: no {session}; set DMAE_DATA to the folder that holds pose2sim/, Pose2Sim's demo session")

clip = dmae.read(session / "S00_P00_T01_BalancingTrial")
print(f"{len(clip)} frames at {clip.fps:g}/s, {len(clip.rig)} cameras, {clip.detections.skeleton.name}")

captured = dmae.capture(clip)
full = dmae.complete(captured, fps=clip.fps)
for name, poses in ("captured", captured), ("completed", full):
    known = (poses.source != dmae.Source.ABSENT).mean()
    print(f"{name:10}{poses.xyz.shape[1]} people, {known:.1%} of the joints known")

# How far the joints of the person on the beam lie from the nearest detection of each camera.
main = (captured.source != dmae.Source.ABSENT).sum((0, 2)).argmax()
pixels, _ = clip.rig.project(captured.xyz[:, main])
distance = np.linalg.norm(pixels[:, :, None] - clip.detections.xy, axis=-1)
nearest = np.nan_to_num(distance, nan=np.inf).min(2)
for view, name in enumerate(clip.rig.names):
    known = nearest[:, view][np.isfinite(nearest[:, view])]
    print(f"camera {name}: median reprojection error {np.median(known):.1f} px")

files = dmae.export(clip, out / "balancing.trc", poses=full)
print("for OpenSim:", ", ".join(file.name for file in files if file.suffix == ".trc"))
dmae.draw(clip, full).savefig(out / "pose2sim_recording.png", dpi=80)
