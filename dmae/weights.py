"""A trained model on disk: `weights.safetensors`, and `model.json` which says what it is and how it came about.

Those that come with the package are in `dmae/models`, a folder each, named as the skeleton that it is for.
"""

import hashlib
import json
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from dmae.model import DMAE, ModelConfig
from dmae.skeleton import Skeleton, get_skeleton
from dmae.store import read_json, write_atomic

FORMAT = 4

SHIPPED = Path(__file__).parent / "models"


def save_model(model: DMAE, skeleton: Skeleton, folder: Path, record: dict) -> None:
    """Write a model, replacing the one that is there; `record` is JSON-able and says how it was made."""
    folder = Path(folder)
    data = save_tensors({name: tensor.contiguous().cpu() for name, tensor in model.state_dict().items()})
    meta = {
        "format": FORMAT,
        "skeleton": skeleton.name,
        "model": asdict(model.config),
        "versions": {name: metadata.version(name) for name in ("dmae-synth", "torch")},
        **record,
        "sha256": hashlib.sha256(data).hexdigest(),
    }
    # The JSON goes last and holds the checksum: a torn pair is found out on loading.
    write_atomic(folder / "weights.safetensors", data)
    write_atomic(folder / "model.json", json.dumps(meta, indent=1))


def load_model(folder: Path) -> tuple[DMAE, Skeleton, dict]:
    """Read a model, in evaluation mode, on the CPU; its skeleton; and all that `model.json` says.

    Raises:
        FileNotFoundError: there is no model in the folder.
        ValueError: a file is malformed, torn, or of another version of the format or of the network.
    """
    folder = Path(folder)
    described, path = folder / "model.json", folder / "weights.safetensors"
    if not described.is_file() or not path.is_file():
        raise FileNotFoundError(
            f"{folder}: expected a folder that `dmae train` wrote, holding model.json and weights.safetensors"
        )
    meta = read_json(described)
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        found = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
        raise ValueError(f"{described}: expected a model of format {FORMAT}, found {found!r}; train it again")
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != meta.get("sha256"):
        raise ValueError(f"{path}: does not match the checksum in model.json; the weights are damaged, train again")
    try:
        skeleton = get_skeleton(meta["skeleton"])
        model = DMAE(ModelConfig(**meta["model"]), len(skeleton))
        model.load_state_dict(load_tensors(data))
    except (KeyError, TypeError, RuntimeError, SafetensorError) as error:
        raise ValueError(f"{folder}: not a model of this version of dmae: {error}") from None
    return model.eval(), skeleton, meta


def shipped() -> list[str]:
    """The skeletons for which weights come with the package."""
    return sorted(path.parent.name for path in SHIPPED.glob("*/model.json"))


def find_shipped(skeleton: Skeleton) -> Path:
    """The folder of the shipped weights for a skeleton, or else for the one that shares most joints with it.

    Raises:
        ValueError: no weights are shipped for a skeleton with a joint of the same name.
    """
    common = {name: len(set(get_skeleton(name).joints) & set(skeleton.joints)) for name in shipped()}
    best = max(common, key=lambda name: (name == skeleton.name, common[name]), default=None)
    if best is None or not common[best]:
        raise ValueError(
            f"no weights for skeleton {skeleton.name!r} come with this package, which has those for "
            f"{', '.join(common) or 'no skeleton'}; convert the poses (dmae.mapping.convert), or train on that "
            "skeleton (dmae train) and name the folder by weights=..."
        )
    return SHIPPED / best


def pick_device(device: str) -> torch.device:
    """The named device; `auto` is a GPU if there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else torch.device(device)
