"""A benchmark of two clips of a second each, made once for all tests."""

from pathlib import Path

TINY = """
about: Two clips of a second
seed: 5
small: 1
full: 1
options: >-
  scene.seconds=1.2 scene.arena=studio scene.props=[0,0] scene.persons=[2,2] rig=ring rig.ring.views=3
  rig.ring.size=[516,388] rig.ring.focal=500
levels:
  - name: self
    about: Apart
    sets: {apart: scene.gathering=1.0}
  - name: edge
    about: Long lenses
    sets: {standing: rig.ring.focal=700}
"""
IDS = ["1_self/apart/000000", "2_edge/standing/000000"]


def write_tiny(folder: Path) -> Path:
    """Write the definition, without frozen checksums, and return its file."""
    path = folder / "tiny.yaml"
    path.write_text(TINY)
    return path
