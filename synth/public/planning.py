"""Plan cameras: their number and their places."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.cli import compose
from synth.cli import SYNTH

if TYPE_CHECKING:
    from synth.planning.plan import CameraPlan


def plan(
    *overrides: str,
    arena: str | Path | None = None,
    cameras: Sequence[int] = (4, 6),
    persons: Sequence[int] | None = None,
    detector: str = "shelf_openpose",
    seed: int = 0,
    workers: int = 1,
    out: str | Path | None = None,
) -> CameraPlan:
    """Plan where to mount cameras in a room, and measure the capture of simulated people for each number of cameras.

        plan = synth.plan("mount.ceiling=false", arena="room.xml", cameras=[4, 8], persons=[1, 4], out="runs/plan")
        clips = synth.generate("rig.path=runs/plan/cameras_4.toml", rig="ring")

    Args:
        overrides: Options that are not named here, as on the command line: `"lens.view_deg=[60,90]"`.
        arena: Room of `scenes/`, or path of an MJCF file; by default the room of `scene`, which is `office`.
        cameras: Least and greatest number of cameras.
        persons: Least and greatest number of people; by default the numbers of `scene`.
        detector: Name of a preset: errors of the 2D detector.
        seed: Seed of people and detector; 0 is a valid seed.
        workers: Processes; -1 for one per core.
        out: Folder of the page, the rigs and the lists to print, which must not exist or be empty; by default nothing
            is written.

    Returns:
        `rigs`, one for each number of cameras. `plan[4]` is the one with four cameras, with its `rig`, its `figures`
        (PCP, error, joints not measured, identities confused, each with an interval), `worth` (the gain from each
        camera), and `floor` (the coverage of the floor).

    Raises:
        ValueError: the room has no walls to mount cameras on, heights are outside the room, there are fewer places than
            cameras, or `out` is not empty.
        FailedSimulation: people could not be simulated in the room.

    Examples:
        >>> short = ("scene.seconds=0.4", "search.clips=1", "search.frames=2", "search.check_clips=2")
        >>> found = synth.plan("mount.places=12", *short, arena="studio", cameras=[2, 3], persons=[1, 1])
        >>> len(found[3].rig), len(found[3].worth), sorted(found[3].figures)
        (3, 3, ['error', 'idf1', 'missing', 'pcp', 'switches'])
    """
    from dmae.files.contents import check_vacant, whole_folder
    from synth.planning.page import PAGE, write_files, write_page
    from synth.planning.plan import make_plan

    given = [f"cameras={list(cameras)}", f"detector={detector}", f"seed={seed}", f"workers={workers}"]
    given += [] if arena is None else [f"arena={arena}"]
    given += [] if persons is None else [f"persons={list(persons)}"]
    config = compose(SYNTH.commands["plan"], [*given, *overrides])
    if out is None:
        return make_plan(config)
    check_vacant(Path(out), "the plan")
    made = make_plan(config)
    with whole_folder(Path(out)) as partial:
        write_files(made, partial)
        write_page(made, partial / PAGE)
    return made
