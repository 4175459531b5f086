"""The `synth` command."""

from dataclasses import replace
from pathlib import Path

from dmae.cli import Command, run_command
from synth.compare import CompareConfig, run_compare
from synth.compare_motion import CompareMotionConfig, run_compare_motion
from synth.dataset import generate
from synth.generate import GenerateConfig
from synth.preset import FitDetectorConfig, run_fit_detector
from synth.show import ShowConfig, run_show
from synth.verify import VerifyConfig, run_verify


def run_generate(config: GenerateConfig, out: Path) -> None:
    lines = generate(replace(config, out=str(out)))
    failed = [line for line in lines if line["status"] != "ok"]
    for line in failed:
        print(f"{line['id']}: failed after {line['attempts']} attempts: {line['reason']}")
    print(f"{out}: {len(lines) - len(failed)} clips, {len(failed)} failed")


COMMANDS = {
    "generate": Command(lambda: GenerateConfig, run_generate, "simulate clips with exact truth"),
    "compare": Command(lambda: CompareConfig, run_compare, "a recording and its simulation side by side"),
    "compare-motion": Command(
        lambda: CompareMotionConfig, run_compare_motion, "how recorded and how generated people move, side by side"
    ),
    "fit-detector": Command(lambda: FitDetectorConfig, run_fit_detector, "a detector's preset from a recording"),
    "show": Command(lambda: ShowConfig, run_show, "a clip as contact sheet, video and Rerun recording"),
    "verify": Command(lambda: VerifyConfig, run_verify, "check that clips are whole and true"),
}


def main() -> None:
    run_command("synth", COMMANDS)
