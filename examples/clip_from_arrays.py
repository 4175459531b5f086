"""Your own arrays become a clip: cameras, 2D detections, and whatever else you know.

One person waves in front of four cameras. For a second, all but one camera lose the waving arm. Capture leaves the
arm out there, because one camera cannot measure depth; completion fills it in, in red, and says that it did.
"""

import sys
from pathlib import Path

import numpy as np

import dmae

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)

# Four cameras on a circle of 4 m, looking at a point 1 m above the origin. World: metres, z up.
angle = np.radians([45, 135, 225, 315])
centres = np.stack([4 * np.cos(angle), 4 * np.sin(angle), np.full(4, 2.0)], -1)
forward = (0, 0, 1) - centres
forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
right = np.cross(forward, (0, 0, 1))
right /= np.linalg.norm(right, axis=-1, keepdims=True)
cam_from_world = np.tile(np.eye(4), (4, 1, 1))
cam_from_world[:, :3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
cam_from_world[:, :3, 3] = -np.einsum("vij,vj->vi", cam_from_world[:, :3, :3], centres)
K = np.tile([[900, 0, 640], [0, 900, 360], [0, 0, 1]], (4, 1, 1))
rig = dmae.CameraRig(
    ("north", "west", "south", "east"), K, np.zeros((4, 5)), cam_from_world, np.tile((1280, 720), (4, 1))
)

# 75 frames of one person: (F, P, J, 3) m. COCO's 17 joints, the right arm waving.
skeleton = dmae.get_skeleton("coco17")
half = {"eye": (0.08, 0.03, 1.66), "ear": (0, 0.07, 1.64), "shoulder": (0, 0.18, 1.45), "elbow": (0, 0.25, 1.17),
        "wrist": (0, 0.28, 0.92), "hip": (0, 0.1, 0.95), "knee": (0.02, 0.1, 0.5), "ankle": (0, 0.1, 0.08)}  # fmt: skip
body = [(0.1, 0, 1.62) if j == "nose" else np.array(half[j[2:]]) * (1, 1 if j[0] == "l" else -1, 1)
        for j in skeleton.joints]  # fmt: skip
time = np.arange(75) / 25
xyz = np.tile(np.array(body, float), (75, 1, 1, 1))
elbow, wrist = skeleton.index("r_elbow", "r_wrist")
swing = 0.7 * np.sin(2 * np.pi * 0.8 * time)
xyz[:, 0, elbow] = (0, -0.45, 1.45)
xyz[:, 0, wrist] = np.stack([0 * swing, -0.45 - 0.25 * np.sin(swing), 1.45 + 0.25 * np.cos(swing)], -1)

# What a detector reports: pixels with 1.5 px of noise, and NaN where it sees nothing.
rng = np.random.default_rng(0)
xy = rig.project(xyz)[0] + rng.normal(0, 1.5, (75, 4, 1, 17, 2))
xy[25:50, 1:, :, [elbow, wrist]] = np.nan
score = np.where(np.isnan(xy[..., 0]), np.nan, 0.9)

clip = dmae.Clip("wave", 25.0, rig, dmae.Detections2D(skeleton, xy, score), truth=dmae.Poses3D(skeleton, xyz))
captured = dmae.capture(clip)
full = dmae.complete(captured, fps=clip.fps)
for name, poses in ("captured", captured), ("completed", full):
    scores = dmae.evaluate(clip, poses)
    print(f"{name:10} PCP {scores['pcp']:5.1f} %   absent {scores['shares']['absent']:.1f} % of the joints   "
          f"error {scores['mpjpe']['all']:.1f} mm")  # fmt: skip
print(f"error of completed joints {scores['mpjpe']['completed']:.1f} mm")
dmae.draw(clip, full, frame=37).savefig(out / "clip_from_arrays.png", dpi=80)
