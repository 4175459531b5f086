"""`synth plan`: plan the number of cameras and their places."""

from pathlib import Path

from dmae.progress import duration
from dmae.reporting.tables import print_tables
from synth.planning.config import PlanConfig
from synth.planning.page import PAGE, mounting_table, numbers_table, write_plan
from synth.planning.plan import forecast_plan
from synth.rooms.room import load_room


def run(config: PlanConfig, out: Path) -> None:
    """Plan the cameras, print the figures and the mounting places, and write the page, the rigs and the lists."""
    for clause in load_room(config.setting().arena).filled:
        print(f"{config.setting().arena}: {clause}")
    if config.dry_run:
        found = forecast_plan(config)
        print(
            f"{out}: {found.candidates} candidate cameras, {found.clips} clips to simulate, {found.captures} captures: "
            f"about {duration(found.seconds)}"
        )
        return
    plan = write_plan(config, out)
    print_tables([numbers_table(plan), *(mounting_table(each) for each in plan.rigs)])
    print(out / PAGE)
