"""Curves of the errors of several detectors."""

from matplotlib.figure import Figure

_COLUMNS = (
    ("cause", "what hides the joint"),
    ("margin of hidden joints", "depth margin of hidden joints"),
    ("size, visible", "size, visible joints"),
    ("crowding, hidden", "nearest other person, hidden joints"),
)
_ROWS = (("near", "joints within 5 % of the height, %"), ("confidence", "mean confidence, %"), ("missed", "missed, %"))
_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple", "tab:brown")
_SHORT = (("hidden by ", ""), ("the own body", "self"), ("another person", "person"), ("an object", "object"),
          (" or more", "+"), (" to ", "-"), (" heights", " h"))  # fmt: skip


def draw_errors(studied: dict[str, dict]) -> Figure:
    """Return curves of near joints, confidence and misses by cause, margin, size and crowding, a line per detector.

    Args:
        studied: Results of `synth.recognition.error_tables.numbers` by name of the detector.
    """
    figure = Figure(figsize=(14, 8), layout="constrained")
    axes = figure.subplots(len(_ROWS), len(_COLUMNS), sharey="row", squeeze=False)
    for column, (heading, label) in enumerate(_COLUMNS):
        groups = list(dict.fromkeys(
            row["group"] for each in studied.values() for row in each["joints"] if row["heading"] == heading
        ))  # fmt: skip
        for row, (value, title) in enumerate(_ROWS):
            ax = axes[row, column]
            for number, (name, each) in enumerate(studied.items()):
                found = {line["group"]: line for line in each["joints"] if line["heading"] == heading}
                places = [i for i, group in enumerate(groups) if found.get(group, {}).get(value) is not None]
                heights = [100 * found[groups[i]][value] for i in places]
                ax.plot(places, heights, "o-", color=_COLOURS[number % len(_COLOURS)], label=name)
            ax.set_xticks(range(len(groups)), [_shortened(group) for group in groups], fontsize=8)
            ax.set_xlim(-0.3, max(len(groups) - 0.7, 0.3))
            ax.grid(color="#dddddd")
            if column == 0:
                ax.set_ylabel(title)
            if row == len(_ROWS) - 1:
                ax.set_xlabel(label)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(studied))
    return figure


def _shortened(group: str) -> str:
    for long, short in _SHORT:
        group = group.replace(long, short)
    return group
