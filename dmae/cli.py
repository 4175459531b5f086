"""The `dmae` command, and how `synth` and it are run. Hydra runs commands here, and is imported for that alone.

`dmae/command_line/spelling.py` reads values with Hydra's parser; no other module knows Hydra.
"""

import atexit
import errno
import gc
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import NoReturn

from dmae.command_line import interruption
from dmae.command_line.help import command_help, program_help
from dmae.command_line.inputs import check_inputs
from dmae.command_line.options import Command, Group, Option, Presets, Program, presets_of
from dmae.command_line.outputs import check_out, locked, record
from dmae.command_line.spelling import checked, split_flags
from dmae.commands import COMMANDS
from dmae.formats.registry import reader
from dmae.nearest import choices

_HELP = ("-h", "--help")
DMAE = Program(
    "dmae",
    "Capture people with several cameras, complete the joints on which fewer than two agree, and score the result.",
    COMMANDS,
    {"data": presets_of(reader, "name")},
)


def main() -> None:
    run_program(DMAE)


def run_program(program: Program) -> None:
    """Run `program command key=value ...` from `sys.argv`. Exits with status 1 and one line on bad input, with 130 and
    one line on Ctrl-C.
    """
    interruption.began = time.monotonic()
    # Nothing that is loaded is garbage: looking for it, also at exit, takes a quarter of the time to load `dmae train`.
    gc.disable()
    atexit.register(gc.freeze)
    # By default PyTorch's threads wait for each other in a loop. Where other programs run, training takes three to five
    # times as long then; alone, it takes 7 % less.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        _run_program(program)
    except BrokenPipeError:
        _end_without_reader()
    finally:
        interruption.began = None
        gc.enable()


def _end_without_reader() -> NoReturn:
    """Exit because the reader closed the pipe, as in `dmae --help | head`. Python must not write to it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(1)


def _run_program(program: Program) -> None:
    # `--help=data` as `--help data`
    typed = [part for each in sys.argv[1:] for part in (each.split("=", 1) if each.startswith("--help=") else [each])]
    name, *arguments = typed or ["--help"]
    if name == "--version":
        from importlib import metadata  # a tenth of the time of `--help`, which does not need it

        print(f"{program.name} {metadata.version('dmae-synth')}")
        return
    if name in (*_HELP, "help"):
        if not arguments:
            print(program_help(program))
            return
        name, *topics = arguments
        arguments = ["--help", *topics]
    if name not in program.commands:
        other = "synth" if program.name == "dmae" else "dmae"
        sys.exit(f"{program.name}: no command {name!r}; {choices(name, program.commands)}; {other} --help lists others")
    command = program.commands[name]
    full = bool(os.environ.get("HYDRA_FULL_ERROR"))
    with interruption.one_line(str(command)) as interrupted, _errors_in_one_line(command, interrupted, full):
        _run_command(command, arguments, interrupted)


@contextmanager
def _errors_in_one_line(command: Command, interrupted: interruption.Interruption, full: bool) -> Iterator[None]:
    """End the command with one line on an error of its input in the block; `full` raises it."""
    try:
        yield
    except BrokenPipeError:
        _end_without_reader()
    except Exception as error:
        if interrupted.signal:
            # The command was interrupted: an error of its workers, which end with it, is a consequence.
            raise KeyboardInterrupt from None
        if full or not (isinstance(error, (ValueError, KeyError, OSError)) or _of_hydra(error)):
            raise
        sys.exit(f"{command}: error: {_in_one_line(error)}")


def _run_command(command: Command, arguments: list[str], interrupted: interruption.Interruption) -> None:
    options = command.options()
    if asked := [place for place, argument in enumerate(arguments, 1) if argument in _HELP]:
        topics = [argument for argument in arguments[asked[0] :] if "=" not in argument]
        print(command_help(command, options, *topics[:1]))
        return
    flags, folders, overrides = split_flags(arguments)
    options, own, overrides = _with_own_presets(command, options, folders, overrides)
    overrides = checked(options, overrides, flags, presets=bool(folders))
    for override in overrides:
        if override.startswith("out=") and not set("$'\"") & set(override):
            check_out(override.removeprefix("out="), "folder" if "--multirun" in flags else command.writes)
    _run_hydra(command, options, own, [*flags, *overrides], interrupted)


def _with_own_presets(
    command: Command, options: Group, folders: Sequence[Path], overrides: Sequence[str]
) -> tuple[Group, Presets, list[str]]:
    """Return options with the user's presets, these presets, and overrides with their names."""
    if not folders and not any(".yaml" in override for override in overrides):
        return options, {}, [*overrides]
    from dmae.command_line.presets import own_presets  # it loads NumPy, which `--help` does not need

    own, taken = own_presets(command, options, folders, overrides)
    return command.options(own), own, taken


def _run_hydra(
    command: Command, options: Group, own: Presets, arguments: list[str], interrupted: interruption.Interruption
) -> None:
    """Hand a command to Hydra, which composes its configuration and runs it, for a sweep several times."""
    import hydra
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    sys.argv = [str(command), *arguments]
    full = os.environ.get("HYDRA_FULL_ERROR")

    def application(config) -> None:
        if HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN:
            print(" ".join(each for each in HydraConfig.get().overrides.task if each not in arguments))
        # Here as well: Hydra would print a message of its own for an error that leaves the job.
        with _errors_in_one_line(command, interrupted, bool(full)):
            _apply(command, options, config, interrupted)

    with _stored(command, options, own, arguments):
        if any(argument.startswith("-") or "hydra" in argument for argument in arguments):
            # With this setting Hydra raises errors instead of printing them in several lines.
            os.environ["HYDRA_FULL_ERROR"] = "1"
            try:
                # By default Hydra takes the folders of this package for groups: `data`, `calibration`, `online`.
                hydra.main(version_base="1.3", config_path="pkg://hydra.conf", config_name=command.name)(application)()
            finally:
                os.environ["HYDRA_FULL_ERROR"] = full or ""
                HydraConfig.instance().cfg = None  # The next command of this process is no part of this sweep
            return
        # Hydra's own program composes twice, first to learn whether it is to sweep.
        with hydra.initialize(version_base="1.3"):
            config = hydra.compose(command.name, overrides=arguments)
    application(config)


def _apply(command: Command, options: Group, config, interrupted: interruption.Interruption) -> None:
    """Run a command with a configuration as Hydra composed it, and record the configuration with the output."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode
    from omegaconf import OmegaConf

    from dmae.parallel import Backend, running_on  # it loads NumPy, which `--help` does not need
    from dmae.progress import waiting

    missing = sorted(OmegaConf.missing_keys(config))
    if missing:
        raise ValueError(f"expected {', '.join(f'{key}=...' for key in missing)}")
    values, out = OmegaConf.to_object(config), None
    check_inputs(values, options)
    with waiting("loading"):
        module = command.module
    interrupted.check()
    gc.enable()
    if "out" in config:
        given = config.out
        if given is not None and HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN:
            # Hydra makes a folder for each combination; a command that writes a file has it in there.
            folder = Path(HydraConfig.get().runtime.output_dir)
            given = folder / Path(given).name if command.writes == "file" else folder
        out = module.default_out(values) if given is None else Path(given)
        out = getattr(module, "written_path", lambda _, out: out)(values, out)
        check_out(out, command.writes)
    usual = "nothing is left behind" if out is None else f"nothing was written to {out}; run it again"
    describe, dry_run = getattr(module, "interrupted", lambda *_: usual), getattr(values, "dry_run", False)
    interrupted.describe = lambda: "nothing was made, as in any dry run" if dry_run else describe(values, out)
    lock = locked(out, getattr(values, "first", None)) if out else nullcontext()
    with lock, running_on(getattr(values, "backend", Backend.loky)):
        verdict = None
        try:
            module.run(values, out)
        except SystemExit as exit:
            if interrupted.signal:
                raise
            # A command that exits with a verdict has finished its work, whatever the verdict is.
            verdict = exit
        if out and not dry_run:
            record(OmegaConf.to_yaml(config, resolve=True), out)
        if verdict:
            raise verdict


def compose(command: Command, overrides: Sequence[str]) -> object:
    """Return the configuration that `command overrides...` would run with; ValueError for a wrong option or value."""
    import hydra
    from omegaconf import OmegaConf

    options, own, overrides = _with_own_presets(command, command.options(), (), overrides)
    overrides = checked(options, overrides)
    try:
        with _stored(command, options, own, overrides), hydra.initialize(version_base="1.3"):
            return OmegaConf.to_object(hydra.compose(command.name, overrides=overrides))
    except Exception as error:
        if not _of_hydra(error):
            raise
        raise ValueError(_in_one_line(error)) from None


class _Uncopied(dict):
    """What Hydra has. It copies all of it for each composition, and then each part that it reads."""

    def __deepcopy__(self, memo: dict) -> "_Uncopied":
        return self


@contextmanager
def _stored(command: Command, options: Group, own: Presets, arguments: Sequence[str]) -> Iterator[None]:
    """Give Hydra the schema and the presets of a command for the block."""
    from hydra.core.config_store import ConfigNode, ConfigStore

    store = ConfigStore.instance()
    # `data=...` and others are groups of presets for some commands, and plain paths for others.
    other = {member.key for member in options.members}
    before, store.repo = store.repo, _Uncopied({name: node for name, node in store.repo.items() if name not in other})
    schema = f"{command.name}_schema"
    store.repo[f"{schema}.yaml"] = ConfigNode(schema, _schema(command.configuration), None, None, None)
    groups = [{group: preset} for group, preset in command.presets.items()]
    # Hydra writes nothing of its own; results go to `out`, and under `-m` to `out/0`, `out/1`, ...
    silent = [{f"override hydra/{each}_logging": "none"} for each in ("job", "hydra")]
    out = options.find("out")
    given = any(argument.startswith("out=") for argument in arguments)
    sweep = "${out}" if isinstance(out, Option) and (given or out.default is not None) else f"runs/{command.name}"
    own_files = {"output_subdir": None, "run": {"dir": "."}, "sweep": {"dir": sweep, "subdir": "${hydra.job.num}"}}
    defaults = [schema, *groups, "_self_", *silent]
    store.store(name=command.name, node={"defaults": defaults, "hydra": own_files})
    # Only presets that may be meant: Hydra takes milliseconds for each.
    asked = f"{arguments} {own} {command.presets}"
    for group in command.presets:
        for name, preset in {**command.presets_of(group), **own.get(group, {})}.items():
            if name in asked or "glob(" in asked:
                store.store(group=group, name=name, node=preset.values, package="_global_" if preset.whole else None)
    try:
        yield
    finally:
        store.repo = before


@cache
def _schema(configuration: type):
    """A dataclass as Hydra's schema: OmegaConf takes a frozen one to forbid overrides."""
    from omegaconf import DictConfig, OmegaConf

    node = OmegaConf.structured(configuration)

    def thaw(part):
        part._set_flag("readonly", None)
        if OmegaConf.get_type(part) is dict and not part:
            # An empty dictionary accepts any entries; the command checks them.
            part._set_flag("struct", False)
        for _, child in part.items_ex(resolve=False):
            if isinstance(child, DictConfig):
                thaw(child)

    thaw(node)
    return node


def _of_hydra(error: Exception) -> bool:
    return type(error).__module__.split(".")[0] in ("hydra", "omegaconf")


def _in_one_line(error: Exception) -> str:
    """What to say of an error: of Hydra's and OmegaConf's the reason, without advice to add options."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        # Temporary files have no name that an error states. Their disk, of TMPDIR, may be full while out= has space.
        import tempfile  # it loads modules that `--help` does not need

        return f"{error.strerror}; temporary files are in {tempfile.gettempdir()}, unless TMPDIR names another folder"
    if not _of_hydra(error):
        return str(error.args[0] if isinstance(error, KeyError) and error.args else error)
    first, *more = str(error).splitlines()
    reason = str(error.__cause__).splitlines()[0] if error.__cause__ else ""
    if first.endswith("raised while composing config:") and more:
        # The first line is "In 'detector/mine': ConfigKeyError raised while composing config:", the second the reason.
        first, reason = first.partition(": ")[0], more[0]
    first, reason = first.rstrip("."), reason.rstrip(".")
    for each in filter(None, (error.__cause__, error)):
        kind = getattr(each, "object_type", None)  # of OmegaConf's errors of unknown keys
        key = getattr(each, "key", None)
        if is_dataclass(kind) and key not in (members := [member.name for member in fields(kind)]):
            reason = f"{reason or first}; {choices(str(key), members)}"
            break
    if "hydra/launcher/submitit" in first:
        reason = "pip install hydra-submitit-launcher"
    return first if reason in ("", first) else f"{first}: {reason}"
