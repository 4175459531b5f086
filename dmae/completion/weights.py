"""A trained model on disk: `weights.safetensors`, `model.json` with its configuration and recipe, and its model card.

The models that come with the package are in `dmae/models`, a folder each, named after its skeleton.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from torch import Tensor
from torch.overrides import TorchFunctionMode

from dmae.completion.config import ModelConfig
from dmae.completion.fusion import namesakes
from dmae.completion.methods import completion_method
from dmae.completion.network import DMAE
from dmae.data.skeleton import Skeleton, decode_skeleton, encode, get_skeleton
from dmae.data.store import write_atomic
from dmae.data.typed import decode
from dmae.files.contents import read_bytes
from dmae.files.structured import read_json, read_yaml
from dmae.metrics.score_tables import score_tables
from dmae.reporting.tables import counted, markdown_table

FORMAT = 5

OF_PEOPLE = {"l_hip", "r_hip", "l_shoulder", "r_shoulder"}
"""Joints by which the network knows where a body is and faces."""
_LARGEST = 1e6  # Of a weight
SHIPPED = Path(__file__).parents[1] / "models"
PAPER = "paper"
"""Folder there of the paper's network."""
_UNLESS_STATED = {"calibration": None, "denoises": False, "fuses": False}
"""What completion reads of a record; a network that was trained elsewhere states none of it."""


def save_model(model: DMAE, skeleton: Skeleton, folder: str | Path, record: dict) -> None:
    """Write a model, replacing the one that is there. `load_model` and every option `weights` take the folder.

    Raises ValueError if weights are not finite; the message names their tensors.

    Args:
        record: JSON-able; how the model was made. `dmae train` says here that a model fuses or denoises, and how its
            uncertainty is calibrated.
    """
    folder = Path(folder)
    check_finite(model.state_dict(), "nothing was saved")
    data = save_tensors({name: tensor.contiguous().cpu() for name, tensor in model.state_dict().items()})
    meta = {
        "format": FORMAT,
        "skeleton": encode(skeleton),
        "model": asdict(model.config),
        "versions": {name: metadata.version(name) for name in ("dmae-synth", "torch")},
        **record,
        "sha256": hashlib.sha256(data).hexdigest(),
    }
    # The JSON goes last and holds the checksum: files of two models are noticed on loading.
    write_atomic(folder / "weights.safetensors", data)
    write_atomic(folder / "model.json", json.dumps(meta, indent=1))


def load_model(folder: str | Path) -> tuple[DMAE, Skeleton, dict]:
    """Return a model in evaluation mode, on the CPU; its skeleton; and the contents of `model.json`.

    Raises:
        FileNotFoundError: there is no model in the folder.
        ValueError: a file is malformed, damaged, or of another version of the format or of the network.
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
    data = read_bytes(path)
    if hashlib.sha256(data).hexdigest() != meta.get("sha256"):
        raise ValueError(f"{path}: does not match the checksum in model.json; the weights are damaged, train again")
    try:
        skeleton = decode_skeleton(meta["skeleton"], "skeleton")
        tensors, config = load_tensors(data), decode(ModelConfig, meta["model"], "model")
        _check_sizes(config, len(skeleton), tensors)
        model = DMAE(config, len(skeleton), None if config.residual else namesakes(skeleton))
        model.load_state_dict(tensors)
    except (KeyError, TypeError, AttributeError, RuntimeError, ValueError, OverflowError, SafetensorError) as error:
        raise ValueError(f"{folder}: not a model of this version of dmae: {error}") from None
    check_finite(tensors, f"{path} is of no use, train again")
    return model.eval(), skeleton, _UNLESS_STATED | meta


class _Unfilled(TorchFunctionMode):
    """Make tensors without drawing and scaling numbers: tensors without memory would load compilers of 80 MB for it."""

    def __torch_function__(self, function, types, args=(), kwargs=None):
        if function is torch.randn:
            return torch.empty(*args, **(kwargs or {}))
        if function is torch.linspace:
            return torch.empty(args[2])
        if function is Tensor.repeat:
            return torch.empty(args[0].numel() * args[1])
        if function in (Tensor.normal_, Tensor.uniform_, Tensor.mul):
            return args[0]
        return function(*args, **(kwargs or {}))


def _check_sizes(config: ModelConfig, joints: int, tensors: dict[str, Tensor]) -> None:
    """Refuse a network that the tensors do not fit, before any memory is taken for it."""
    with torch.device("meta"), _Unfilled():
        wanted = DMAE(config, joints).state_dict()
    for name in sorted(wanted.keys() | tensors.keys()):
        shapes = [tuple(part[name].shape) if name in part else "none" for part in (wanted, tensors)]
        if shapes[0] != shapes[1]:
            raise ValueError(f"expected {name} of shape {shapes[0]} by model.json, found {shapes[1]}")


def check_finite(tensors: dict[str, Tensor], so: str) -> None:
    """Raise ValueError, which names tensors and ends with `so`, unless all are finite and of a possible size."""
    wrong = [name for name, tensor in tensors.items() if not (tensor.abs() <= _LARGEST).all()]
    if wrong:
        more = f" and {len(wrong) - 3} more" if len(wrong) > 3 else ""
        names = f"{', '.join(wrong[:3])}{more}, of {len(tensors)} tensors"
        raise ValueError(f"weights are not finite, or beyond {_LARGEST:g}, in {names}: {so}")


def shipped() -> list[str]:
    """Return the names of the skeletons for which weights of the default network come with the package."""
    return sorted(path.parent.name for path in SHIPPED.glob("*/model.json") if path.parent.name != PAPER)


def weights_folder(weights: str | Path) -> Path:
    """Return the folder that an option names: `paper` names the paper's network, which comes with the package."""
    return SHIPPED / PAPER if str(weights) == PAPER else Path(weights)


def weights_checksum(weights: str | Path | None) -> str:
    """Return the SHA-256 of `model.json`, which contains the checksum of its weights; None: all that are shipped."""
    files = [weights_folder(weights) / "model.json"] if weights else sorted(SHIPPED.glob("*/model.json"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def find_shipped(skeleton: Skeleton) -> Path:
    """Return the folder of the shipped weights for a skeleton, or else for the one that shares most joints with it.

    Raises ValueError if no weights are shipped for a skeleton with a joint of the same name, or it is of a body of your
    own without the hips and shoulders of people.
    """
    if skeleton.defined and not set(skeleton.joints) >= OF_PEOPLE:
        raise ValueError(
            f"the weights of this package know people, on {', '.join(shipped())}, and nothing of {skeleton.name!r}; "
            "fill it with a method that learns from the recording itself (dmae capture "
            "fill=gaussian_process, dmae evaluate methods=[measured,linear,gaussian_process]). A "
            f"network can be trained (dmae train skeleton=...) on bodies with {', '.join(sorted(OF_PEOPLE))}"
        )
    common = {name: len(set(get_skeleton(name).joints) & set(skeleton.joints)) for name in shipped()}
    best = max(common, key=lambda name: (name == skeleton.name, common[name]), default=None)
    if best is None or not common[best]:
        raise ValueError(
            f"no weights for skeleton {skeleton.name!r} come with this package, which has those for "
            f"{', '.join(common) or 'no skeleton'}; convert the poses (dmae.data.conversion.convert), or "
            f"train on that skeleton (dmae train) and name the folder by weights=..."
        )
    return SHIPPED / best


def methods_for(usual: Sequence[str], skeleton: Skeleton, weights: str | None) -> list[str]:
    """Return the usual methods; without learned ones and `paper` where no weights are given or shipped for the body."""
    try:
        if weights is None:
            find_shipped(skeleton)
    except ValueError:
        return [name for name in usual if name in completion_method and not completion_method[name].learned]
    return list(usual)


# The model card.

_USE = """\
Completes joints of people captured by calibrated cameras where fewer than two cameras agree (`dmae complete`).
Completed joints are estimates, marked `COMPLETED`. Their covariances hold for motion and rigs like the ones that
they were calibrated on, and are unknown (NaN) farther than 0.2 s from any measurement of the person. The model does
not identify people.
"""

_PAPERS_USE = """\
The network of the D-MAE paper alone: completes joints from those in the same window (`dmae complete weights=paper`),
and is where fusion starts (`dmae train model=paper init=paper`). Completed joints are estimates, marked `COMPLETED`,
without covariances. The model does not identify people.
"""

_TERMS = "- **Terms**: `docs/reference/licences.md` states the terms of shipped weights and of recorded motion."

_VALIDATION = "validation "
"""Start of the names of clips from `validation_data`."""

_USUAL = {"input": "captured_poses", "reference": "truth", "skeleton": None, "smooth": 0.1}
"""Options of `dmae evaluate` that are named where they differ from these."""


def model_card(folder: Path, scores: Sequence[Path], command: str) -> str:
    """Return the card as Markdown; every fact is read from files that `dmae train` and `dmae evaluate` wrote.

    Raises:
        FileNotFoundError: one of these files is missing.
        ValueError: scores are of other weights, or a file is malformed.
    """
    try:
        return _card(folder, scores, command)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        files = ", ".join(map(str, (folder, *scores)))
        raise ValueError(f"{files}: expected files that dmae train and dmae evaluate wrote, {error!r:.200}") from None


def _card(folder: Path, scores: Sequence[Path], command: str) -> str:
    model, skeleton, record = load_model(folder)
    # Weights that Python trained have no command's configuration, only the settings that training depends on.
    trained = read_json(folder / "training.json")
    config = _config(folder) if (folder / "config.yaml").is_file() else trained
    held_back = record["validation_clips"]
    learned = [name for name in trained["clips"] if name not in held_back]
    learning = config["learning"]
    settings = {"max_minutes": config["max_minutes"]} | {name: learning[name] for name in ("batch", "lr", "loss")}
    settings = {name: value for name, value in settings.items() if value is not None} | {"seed": config["seed"]}
    start = record.get("init")
    size, network = sum(part.numel() for part in model.parameters()), model.config
    lines = [
        f"# D-MAE for {skeleton.name}",
        "",
        _USE if network.residual else _PAPERS_USE,
        f"- **Network**: {size:,} parameters; windows of {network.frames} frames at {network.fps:g}/s, "
        f"{len(skeleton)} joints; its sizes are in `model.json`.",
        f"- **Learned from**: {_sets(learned, config)}; {record['steps']} steps, {_listed(settings)}.",
        *([f"- **Started from**: weights with the sha256 {start['sha256']}."] if start else []),
        f"- **Validated and calibrated on**: {_sets(held_back, config) or 'nothing'}.",
        f"- **Made by**: `{command}`",
        f"- **Made with**: {_listed(record['versions'])}; sha256 of the weights {record['sha256']}.",
        _TERMS,
        "",
    ]
    for path in scores:
        found = read_json(path / "scores.json")
        config = _config(path)
        used = Path(config["weights"]) if config["weights"] else find_shipped(skeleton)
        if read_json(used / "model.json")["sha256"] != record["sha256"]:
            raise ValueError(f"{path}: the scores are of other weights, {used}; score {folder} with dmae evaluate")
        asked = " ".join(f"{name}={config[name]}" for name, usual in _USUAL.items() if config[name] != usual)
        lines += [f"## {found['recording']}" + (f", `{asked}`" if asked else ""), ""]
        for table in score_tables(found):
            lines += [table.caption, "", markdown_table(table.header, table.rows), ""]
    return "\n".join(lines)


def _config(folder: Path) -> dict:
    return read_yaml(folder / "config.yaml")


def _sets(clips: Sequence[str], config: dict) -> str:
    """Return the number of clips by data set; clips of the first set are named by their number alone."""
    counts = Counter()
    for clip in clips:
        if "data" in config:
            of_validation = clip.startswith(_VALIDATION)
            first = Path(config["validation_data"][0] if of_validation else config["data"]["path"]).name
        else:
            first = "a Python program"
        counts[clip.removeprefix(_VALIDATION).rpartition("/")[0] or first] += 1
    return ", ".join(f"{counted(count, 'clip')} of {name}" for name, count in sorted(counts.items()))


def _listed(facts: dict) -> str:
    return ", ".join(f"{name} {value}" for name, value in facts.items())
