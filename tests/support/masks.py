"""Masks as COCO's own library reads them."""

import numpy as np
from pycocotools import mask as coco_mask

from dmae.formats.labelled_images import RunLengths


def decode_mask(runs: RunLengths) -> np.ndarray:
    """Return the mask (H, W) of bool that run lengths describe."""
    return coco_mask.decode(coco_mask.frPyObjects(runs, *runs["size"])).astype(bool)
