"""`synth plan`: plan the number of cameras and their places."""

from pathlib import Path

from dmae.files.contents import check_vacant, whole_folder
from dmae.parallel import running_on
from dmae.progress import duration
from dmae.reporting.tables import print_tables
from synth.planning.config import PlanConfig
from synth.planning.page import PAGE, mounting_table, numbers_table, write_files, write_page
from synth.planning.plan import forecast_plan, make_plan
from synth.rooms.room import load_room


def run(config: PlanConfig, out: Path) -> None:
    """Plan the cameras, print the figures and the mounting places, and write the page, the rigs and the lists."""
    for clause in load_room(config.setting().arena).filled:
        print(f"{config.setting().arena}: {clause}")
    if config.dry_run:
        with running_on(config.backend):
            found = forecast_plan(config)
        print(
            f"{out}: {found.candidates} candidate cameras, {found.clips} clips to simulate, {found.captures} captures: "
            f"about {duration(found.seconds)}"
        )
        return
    check_vacant(out, "the plan")
    plan = make_plan(config)
    with whole_folder(out) as partial:
        write_files(plan, partial)
        write_page(plan, partial / PAGE)
    print_tables([numbers_table(plan), *(mounting_table(each) for each in plan.rigs)])
    print(out / PAGE)
