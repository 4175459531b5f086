"""A person detector that learns from simulated images, in a minute: render, load, train, look.

The network is tiny: it says for each of 16 x 12 cells whether a nose is in it. The loop is any detector's.
"""

import sys
import tempfile
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import nn
from torch.utils.data import DataLoader, Subset

import synth
from dmae.datasets import FrameDataset

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
epochs = int(sys.argv[2]) if len(sys.argv) > 2 else 25
# Two small cameras, low quality: an image takes milliseconds. No person of the last clip is in the others.
data = tempfile.mkdtemp(prefix="images_")
rig = synth.RigConfig(ring=synth.RingConfig(views=2, size=[128, 96], focal=110))
list(synth.generate(clips=5, seconds=1, seed=1, scene="studio", rig=rig, images=["all"], quality="draft", out=data))
frames = FrameDataset(data, skeleton="coco17", every=2)
held_out = [index for index in range(len(frames)) if frames.place(index)[0] == len(frames.files) - 1]
train = Subset(frames, [index for index in range(len(frames)) if index not in held_out])


def cells(targets):
    """Return (B, 12, 16), 1 in the cells that a visible nose is in."""
    grid = torch.zeros(len(targets), 12, 16)
    for image, target in enumerate(targets):
        nose = target["keypoints"][target["keypoints"][:, 0, 2] == 2, 0]
        grid[image, (nose[:, 1] / 8).long().clamp(0, 11), (nose[:, 0] / 8).long().clamp(0, 15)] = 1
    return grid


torch.manual_seed(0)
layers = [nn.Conv2d(3, 16, 5, 2, 2), nn.ReLU(), nn.Conv2d(16, 32, 5, 2, 2), nn.ReLU(), nn.Conv2d(32, 32, 5, 2, 2)]
model = nn.Sequential(*layers, nn.ReLU(), nn.Conv2d(32, 1, 3, 1, 1), nn.Flatten(1, 2))
optimiser = torch.optim.Adam(model.parameters(), 2e-3)
loss = nn.BCEWithLogitsLoss(pos_weight=torch.tensor(20.0))
for _ in range(epochs):
    for images, targets in DataLoader(train, batch_size=16, shuffle=True, collate_fn=frames.collate):
        value = loss(model(torch.stack(images)), cells(targets))
        optimiser.zero_grad()
        value.backward()
        optimiser.step()
images, targets = frames.collate([frames[index] for index in held_out])
scores, true = model(torch.stack(images)).sigmoid().detach(), cells(targets)
print(f"{len(train)} images of {len(frames.files) - 1} clips, loss {value:.2f} after {epochs} epochs")
nose, other = scores[true == 1].mean(), scores[true == 0].mean()
print(f"people it has not seen: {nose:.2f} in cells with a nose, {other:.2f} in others")
figure = Figure(figsize=(7, 2.8), layout="constrained")
for axes, index in zip(figure.subplots(1, 2), (0, len(images) - 1), strict=True):
    axes.imshow(images[index].permute(1, 2, 0), extent=(0, 128, 96, 0))
    axes.imshow(scores[index], cmap="Reds", alpha=0.5, extent=(0, 128, 96, 0), vmin=0, vmax=1)
    axes.set_axis_off()
figure.savefig(out / "train_a_detector.png", dpi=110)
