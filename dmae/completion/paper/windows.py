"""Windows of poses as the paper's network reads them: centred on the person, rotated at random in training."""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton


class PaperRows(NamedTuple):
    """People one after another; windows do not reach from one to the next."""

    xyz: np.ndarray
    """(S, J, 3) m, world, NaN where unknown: what the encoder may look at, of all joints of the network."""
    truth: np.ndarray
    """(S, J, 3) m, world, NaN where unknown."""
    starts: np.ndarray
    """(W,) first rows of the windows."""


def make_rows(xyz: np.ndarray, truth: np.ndarray, frames: int) -> PaperRows:
    """Return the rows of one recording, (F, P, J, 3) each; windows without a known joint are left out."""
    count, people = xyz.shape[:2]
    if count < frames:
        pad = ((0, frames - count), (0, 0), (0, 0), (0, 0))
        xyz, truth = (np.pad(part, pad, constant_values=np.nan) for part in (xyz, truth))
        count = frames
    xyz, truth = (part.swapaxes(0, 1).reshape(people * count, *part.shape[2:]) for part in (xyz, truth))
    known = (~np.isnan(xyz).any(-1)).any(-1) & (~np.isnan(truth).any(-1)).any(-1)
    first = np.arange(count - frames + 1)
    starts = (np.arange(people)[:, None] * count + first).ravel()
    holds = np.concatenate([[0], np.cumsum(known)])
    return PaperRows(xyz.astype(np.float32), truth.astype(np.float32), starts[holds[starts + frames] > holds[starts]])


def join_rows(parts: list[PaperRows]) -> PaperRows:
    """Return the rows of several recordings."""
    offsets = np.cumsum([0, *(len(part.xyz) for part in parts[:-1])])
    starts = [part.starts + offset for part, offset in zip(parts, offsets, strict=True)]
    xyz, truth = (np.concatenate([getattr(part, name) for part in parts]) for name in ("xyz", "truth"))
    return PaperRows(xyz, truth, np.concatenate(starts))


def cut(rows: PaperRows, starts: np.ndarray, frames: int) -> tuple[Tensor, Tensor]:
    """Return what may be observed and the truth in windows, (B, T, J, 3) m each, NaN where unknown."""
    index = starts[:, None] + np.arange(frames)
    return torch.from_numpy(rows.xyz[index]), torch.from_numpy(rows.truth[index])


def centre(x: Tensor, observed: Tensor, hips: list[int]) -> Tensor:
    """Return the middle of each window's person, (B, 1, 1, 3) m: the mean of observed hips, else of observed joints.

    Args:
        x: (B, T, J, 3) m; not read where `observed` (B, T, J) is False.
        hips: Indices of the hips.
    """
    places, counts = torch.where(observed[..., None], x, 0), observed[..., None].float()

    def mean(joints: slice | list[int]) -> tuple[Tensor, Tensor]:
        count = counts[:, :, joints].sum((1, 2), keepdim=True)
        return places[:, :, joints].sum((1, 2), keepdim=True) / count.clamp(min=1), count

    (middle, known), (everything, _) = mean(hips), mean(slice(None))
    return torch.where(known > 0, middle, everything)


def rotate(x: Tensor, generator: torch.Generator) -> Tensor:
    """Return windows (B, T, J, 3), each rotated about the vertical by a random angle."""
    angle = 2 * torch.pi * torch.rand(len(x), generator=generator)
    cosine, sine, zero = angle.cos(), angle.sin(), torch.zeros_like(angle)
    turn = torch.stack([cosine, -sine, zero, sine, cosine, zero, zero, zero, zero + 1], -1).view(-1, 3, 3)
    return torch.einsum("bij,btkj->btki", turn, x)


def hips_of(skeleton: Skeleton) -> list[int]:
    """Return the indices of the hips of the first of two skeletons."""
    source = skeleton.parts[0]
    return [i for i, joint in enumerate(source.joints) if joint in ("mid_hip", "l_hip", "r_hip")]


def measured_coordinates(poses: Poses3D) -> np.ndarray:
    """Return coordinates of measured joints, NaN elsewhere."""
    return np.where((poses.measured & np.isfinite(poses.xyz).all(-1))[..., None], poses.xyz, np.nan)
