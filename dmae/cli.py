"""The `dmae` command. Every sub-command is a Hydra application; `synth` is built from the same parts."""

import os
import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from dmae import commands, export
from dmae.doctor import DoctorCommand, run_doctor
from dmae.evaluate import EvaluateConfig
from dmae.regress import RegressCommand, run_regress
from dmae.resources import resource_folder
from dmae.store import write_atomic


@dataclass(frozen=True)
class Command:
    """A sub-command: how to get its config's dataclass (some load torch), what it does with a config and an
    output path (None where the config has no `out`), one line of help.
    """

    schema: Callable[[], type]
    run: Callable[[object, Path | None], None]
    summary: str


def run_command(program: str, commands: dict[str, Command]) -> None:
    """Run `program name key=value ...` from `sys.argv`; exits with status 1 and one message on bad input."""
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if name in ("-h", "--help"):
        print(f"usage: {program} COMMAND key=value ...   (Hydra overrides; {program} COMMAND --help lists the keys)\n")
        for key, command in commands.items():
            print(f"  {key:<16}{command.summary}")
        return
    if name not in commands:
        sys.exit(f"{program}: no command {name!r}; there are {', '.join(commands)}")
    sys.argv = [f"{program} {name}", *_expand_data(sys.argv[2:])]
    ConfigStore.instance().store(name=f"{name}_schema", node=_schema(commands[name].schema()))

    @hydra.main(version_base="1.3", config_path=str(resource_folder("dmae", "configs").resolve()), config_name=name)
    def application(config: DictConfig) -> None:
        try:
            _run(commands[name], config)
        except (ValueError, KeyError, OSError) as error:
            if os.environ.get("HYDRA_FULL_ERROR"):
                raise
            message = error.args[0] if isinstance(error, KeyError) and error.args else error
            sys.exit(f"{program} {name}: error: {message}")

    application()


def _run(command: Command, config: DictConfig) -> None:
    missing = sorted(OmegaConf.missing_keys(config))
    if missing:
        raise ValueError(f"expected {', '.join(f'{key}=...' for key in missing)}")
    multirun = HydraConfig.get().mode == RunMode.MULTIRUN
    if "out" not in config:
        command.run(OmegaConf.to_object(config), None)
        return
    out = Path(HydraConfig.get().runtime.output_dir if multirun else config.out)
    try:
        command.run(OmegaConf.to_object(config), out)
    except SystemExit:
        # Commands that end with a verdict have done their work, whatever it is.
        _record(config, out)
        raise
    _record(config, out)


def _record(config: DictConfig, out: Path) -> None:
    """Write the resolved configuration beside what was made with it."""
    folder = out if out.is_dir() else out.parent
    name = "config.yaml" if out.is_dir() else f"{out.name}.config.yaml"
    write_atomic(folder / name, f"# {_versions()}\n{OmegaConf.to_yaml(config, resolve=True)}")


def _versions() -> str:
    packages = ("dmae-synth", "numpy", "torch", "mujoco")
    return ", ".join(
        [f"python {platform.python_version()}", *(f"{name} {metadata.version(name)}" for name in packages)]
    )


def _schema(config: type) -> DictConfig:
    """A dataclass as Hydra's schema. OmegaConf takes a frozen one to forbid overrides; here it only means immutable."""
    node = OmegaConf.structured(config)

    def thaw(part):
        part._set_flag("readonly", None)
        for _, child in part.items_ex(resolve=False):
            if isinstance(child, DictConfig):
                thaw(child)

    thaw(node)
    return node


def _expand_data(overrides: list[str]) -> list[str]:
    """`data=<folder>` is short for `data=clip data.path=<folder>`."""
    names = {path.stem for path in (resource_folder("dmae", "configs") / "data").glob("*.yaml")}
    expanded = []
    for override in overrides:
        key, _, value = override.partition("=")
        if key == "data" and value and not set(value.split(",")) <= names:
            expanded += ["data=clip", f"data.path={value}"]
        else:
            expanded.append(override)
    return expanded


def _train_schema() -> type:
    from dmae.learner import TrainConfig

    return TrainConfig


COMMANDS = {
    "capture": Command(lambda: commands.CaptureCommand, commands.run_capture, "detections to 3D poses"),
    "train": Command(_train_schema, commands.run_train, "learn to complete poses from clips with truth"),
    "complete": Command(
        lambda: commands.CompleteCommand, commands.run_complete, "fill what no camera measured, marked as such"
    ),
    "card": Command(lambda: commands.CardCommand, commands.run_card, "what trained weights are, made of, and good for"),
    "evaluate": Command(lambda: EvaluateConfig, commands.run_evaluate, "score methods over clips and camera subsets"),
    "export": Command(lambda: export.ExportCommand, export.run_export, "poses to a file that others read"),
    "convert": Command(
        lambda: export.ConvertCommand, export.run_convert, "a recording to another format, or to a clip"
    ),
    "doctor": Command(lambda: DoctorCommand, run_doctor, "what is wrong with a calibration and its detections"),
    "report": Command(lambda: commands.ReportCommand, commands.run_report, "scores and pictures as one page"),
    "regress": Command(lambda: RegressCommand, run_regress, "any triangulation against a frozen pack of cases"),
}


def main() -> None:
    run_command("dmae", COMMANDS)
