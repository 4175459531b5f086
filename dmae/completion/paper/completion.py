"""Completion by the paper's network alone: no interpolation, no features, no blending of windows, no fallback."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from dmae.completion import fusion
from dmae.completion.paper.network import PaperDMAE
from dmae.completion.paper.training import SKELETON, load_paper
from dmae.completion.paper.windows import centre, hips_of, measured_coordinates
from dmae.completion.weights import pick_device
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.numerics.filling import present, resample

_BATCH = 64


@dataclass(frozen=True)
class PaperCompleter:
    """A callable of poses (F, P, J) and their frames per second that returns completed poses.

    Each frame is predicted once, from the window with this frame in the middle; at the ends of a recording from the
    first or the last window. A frame is completed if its person is present (`dmae.numerics.filling.present`) and its
    window contains a measurement. A pretrained network returns poses on its own skeleton, with measured joints as they
    were; a tuned one returns the skeleton that it was tuned on, with no measured joint. Covariances are unknown.

    Raises (when called):
        KeyError: the skeleton cannot be converted to that of the network.
    """

    model: PaperDMAE
    tuned: bool

    @property
    def source(self) -> Skeleton:
        """The skeleton of poses that are completed; others are converted."""
        return get_skeleton(SKELETON).parts[0]

    def __call__(self, poses: Poses3D, fps: float) -> Poses3D:
        poses = convert(poses.without(poses.source == Source.COMPLETED), self.source)
        rate = self.model.network.fps
        slow = poses if abs(rate / fps - 1) < 0.01 else resample(poses, fps, rate)
        predicted = self._predict(measured_coordinates(slow))
        if slow is not poses:
            predicted = _at_times(predicted, np.arange(len(poses.xyz)) * rate / fps)
        there = present(poses, fps) & ~np.isnan(predicted).any((2, 3))
        if self.tuned:
            target = get_skeleton(SKELETON).parts[1]
            return fusion.fused(poses, target, predicted[:, :, len(self.source) :], there)
        filled = (poses.source == Source.ABSENT) & there[..., None]
        xyz = np.where(filled[..., None], predicted[:, :, : len(self.source)], poses.xyz)
        return replace(poses, xyz=xyz, source=np.where(filled, Source.COMPLETED, poses.source))

    def _predict(self, xyz: np.ndarray) -> np.ndarray:
        """Return every joint (F, P, J, 3) m, world, NaN where a window holds no measurement; xyz has the source's."""
        network, joints = self.model.network, self.model.joints
        frames, people = xyz.shape[:2]
        length = max(frames, network.frames)
        padded = np.full((length, people, joints, 3), np.nan, np.float32)
        padded[:frames, :, : len(self.source)] = xyz
        first = np.clip(np.arange(frames) - network.frames // 2, 0, length - network.frames)
        places = [(person, frame) for person in range(people) for frame in range(frames)]
        found = np.full((frames, people, joints, 3), np.nan)
        asked = None if self.tuned else len(self.source)
        device = next(self.model.parameters()).device
        for begin in range(0, len(places), _BATCH):
            person, frame = np.array(places[begin : begin + _BATCH]).T
            index = first[frame][:, None] + np.arange(network.frames)
            x = torch.from_numpy(padded[index, person[:, None]])
            observed = ~torch.isnan(x).any(-1)
            middle = centre(x, observed, hips_of(get_skeleton(SKELETON)))
            with torch.inference_mode():
                done = self.model((x - middle).nan_to_num().to(device), observed.to(device), asked).cpu() + middle
            done = done[torch.arange(len(frame)), torch.from_numpy(frame - first[frame])].numpy()
            seen = observed.any(2).any(1).numpy()
            found[frame[seen], person[seen], : done.shape[1]] = done[seen]
        if asked is not None:
            # Joints of the second skeleton are not asked for; NaN would hide the others.
            found[:, :, asked:] = np.where(np.isnan(found[:, :, :1]), np.nan, 0)
        return found


def _at_times(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return (F, ...) at other times, in frames, by straight lines."""
    first = np.minimum(time.astype(int), len(values) - 1)
    second = np.minimum(first + 1, len(values) - 1)
    share = (time - first).clip(0, 1).reshape(-1, *[1] * (values.ndim - 1))
    return np.where(share > 0, values[first] * (1 - share) + values[second] * share, values[first])


def load_paper_completer(folder: Path, device: str = "auto") -> PaperCompleter:
    """Return the completer of a folder that `dmae train-paper` wrote; errors as in `load_paper`."""
    model, record = load_paper(folder)
    return PaperCompleter(model.to(pick_device(device)), record["stage"] == "tuned")
