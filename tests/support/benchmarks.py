"""A benchmark of two clips of a second each."""

from pathlib import Path

TINY = (Path(__file__).parents[1] / "data/tiny_benchmark.yaml").read_text()
IDS = ["1_self/apart/000000", "2_edge/standing/000000"]


def write_tiny(folder: Path) -> Path:
    """Write the definition, without frozen checksums, and return its file."""
    path = folder / "tiny.yaml"
    path.write_text(TINY)
    return path
