"""The `synth` command."""

from dataclasses import replace
from pathlib import Path

from dmae.cli import Command, run_command
from synth.generate import GenerateConfig, generate


def run_generate(config: GenerateConfig, out: Path) -> None:
    lines = generate(replace(config, out=str(out)))
    failed = [line for line in lines if line["status"] != "ok"]
    for line in failed:
        print(f"{line['id']}: failed after {line['attempts']} attempts: {line['reason']}")
    print(f"{out}: {len(lines) - len(failed)} clips, {len(failed)} failed")


COMMANDS = {
    "generate": Command(lambda: GenerateConfig, run_generate, "simulate clips with exact truth"),
}


def main() -> None:
    run_command("synth", COMMANDS)
