"""The completion methods by name: how joints on which fewer than two cameras agree are filled.

Listing them imports none. A method is a function under the decorator `completion_method`, in any file of this folder;
one file adds one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING

from dmae.registry import Entry, OutsideError, Registry, takes

if TYPE_CHECKING:
    from dmae.data.clip import Poses3D

Fill = Callable[["Poses3D", float], "Poses3D"]
"""Takes poses and their frames per second; returns poses of the same shape, in which filled joints are `COMPLETED`,
with 0 views, or as many as the rejected measurement had."""


@dataclass(frozen=True)
class CompletionMethod(Entry):
    """How joints on which fewer than two cameras agree are filled."""

    # Whether the function takes a folder of weights (None: those in the package) and returns a function that fills
    # poses. Other functions fill poses themselves.
    learned: bool = False
    smooths: bool = False  # Its result needs no smoothing: it is smooth, or it is what was measured

    def load(self, weights: Path | None = None) -> Fill:
        """Return what fills poses: a function of poses and their frames per second.

        Args:
            weights: Folder that `dmae train` wrote, for a learned method; by default the weights that come with the
                package.
        """
        return self.function(weights) if self.learned else _of_any_size(self.function)


completion_method = Registry("completion_method", CompletionMethod, __package__, "dmae.online", option="method")
find_method = completion_method.find


_MOVED = 1e-4
"""Distance, m, by which a joint has moved, and is not rounded."""


def _check_marks(filled: Poses3D, given: Poses3D) -> None:
    """Raise ValueError if a user's method returned other people or frames, or calls joints measured that it made up or
    moved: reports, exports and scores would hand them on as measured.
    """
    import numpy as np  # names of methods are listed without it

    from dmae.data.clip import Source

    if filled.xyz.shape[:2] != given.xyz.shape[:2]:
        frames, persons = given.xyz.shape[:2]
        raise ValueError(
            f"expected poses of {persons} persons in {frames} frames back, found {filled.xyz.shape[1]} in "
            f"{len(filled.xyz)}"
        )
    if filled.skeleton != given.skeleton:
        return
    made_up = filled.measured & ~given.measured
    if made_up.any():
        raise ValueError(
            f"{made_up.sum()} joints that no camera measured are marked as measured, as all joints of "
            "dmae.Poses3D(skeleton, xyz) are; expected Source.COMPLETED, as in replace(poses, xyz=xyz, source=source)"
        )
    kept = (filled.source == Source.MEASURED) & (given.source == Source.MEASURED)
    moved = np.linalg.norm(filled.xyz - given.xyz, axis=-1)[kept]
    if (moved > _MOVED).any():
        raise ValueError(
            f"joints marked as measured were moved by up to {1000 * moved.max():.3g} mm; expected measured "
            "joints as they were, or Source.DENOISED for joints that the function changes"
        )


@cache
def _of_any_size(function: Fill) -> Fill:
    """Return the function for bodies of any size and for stills, the same one each time."""
    from dmae.data.clip import Poses3D
    from dmae.data.conversion import for_any_size
    from dmae.numerics.filling import are_stills, fill_stills

    name = f"{function.__module__}:{function.__name__}"
    if not takes(function, "poses", "fps"):
        raise ValueError(f"method {name}: expected a function of poses and their frames per second")

    def poses_of(poses: Poses3D, fps: float) -> Poses3D:
        if name.startswith("dmae."):
            return function(poses, fps)
        # A function of the user may fill its argument in place, which must not change the captured poses.
        given = replace(poses, xyz=poses.xyz.copy(), source=poses.source.copy())
        try:
            filled = function(given, fps)
            if isinstance(filled, Poses3D):
                _check_marks(filled, poses)
                return replace(filled)  # checks the sources again
        except OutsideError:
            raise
        except ValueError as error:
            raise ValueError(f"method {name}: {error}") from error
        raise ValueError(f"method {name}: expected it to return dmae.Poses3D, found {type(filled).__name__}")

    fill = for_any_size(poses_of)

    @wraps(function)
    def at_any_rate(poses: Poses3D, fps: float) -> Poses3D:
        return fill_stills(fill, poses) if are_stills(fps) else fill(poses, fps)

    return at_any_rate
