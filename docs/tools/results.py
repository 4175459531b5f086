"""Figures in pages: every number that was measured comes from a file in `docs/results/`, which a command wrote.

In a page, `<!-- results: pcp_table("shelf") -->` and `<!-- end -->` enclose the value of an expression of the functions
below; `python docs/tools/pages.py` writes it.
"""

import html
import json
import re
from pathlib import Path

import tutorials
from scipy.stats import binomtest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/results"

METHODS = {
    "measured": "measured joints only",
    "linear": "linear filling",
    "pchip_body": "monotone cubics in the body's frame (`pchip_body`)",
    "kalman": "Kalman smoother (`kalman`)",
    "reject_pchip": "contradicted joints rejected, then `pchip_body` (`reject_pchip`)",
    "rays": "`pchip_body`, on the ray where one camera saw the joint (`rays`)",
    "gaussian_process": "`rays`, then a Gaussian process over similar poses (`gaussian_process`)",
    "reject_gaussian_process": "contradicted joints rejected, then `gaussian_process` (`reject_gaussian_process`)",
    "dmae": "D-MAE (`dmae`); measured joints are not changed",
    "dmae_reject": "D-MAE, contradicted joints rejected (`dmae_reject`)",
    "dmae_denoise": "**D-MAE as `dmae complete` runs by default** (`dmae_denoise`)",
    "dmae_online": "D-MAE during a recording (`dmae_online`)",
}


def load(name: str) -> dict:
    """Return the results file of that name.

    Raises:
        FileNotFoundError: the file does not exist; the message lists the existing ones.
    """
    path = FOLDER / f"{name}.json"
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such results; there are {sorted(file.stem for file in FOLDER.glob('*'))}")
    return json.loads(path.read_text())


def value(name: str, *keys: str | int, digits: int = 1, scale: float = 1) -> str:
    """Return one number of a results file, by the keys that lead to it."""
    found = load(name)
    for key in keys:
        found = found[key]
    return f"{scale * found:.{digits}f}" if isinstance(found, int | float) else str(found)


def values_table(name: str, key: str, columns: dict[str, str], rows: dict[str, str]) -> str:
    """Return a table of whole numbers of a results file: `columns` and `rows` are headings by key."""
    found = load(name)[key]
    cells = [[heading, *(f"{found[column][row]:.0f}" for column in columns)] for row, heading in rows.items()]
    return _table(["", *columns.values()], cells)


def memory_table(name: str) -> str:
    """Return a table of memory, MB, by command, with a long and a short recording."""
    result = load(name)
    commands = [
        f"`dmae {command.replace(' ', ' format=')}`" if command.startswith("export") else f"`dmae {command}`"
        for command in result["found"]
    ]
    rows = [
        [command, f"{each['mb']:.0f}", f"{each['mb_of_short']:.0f}"]
        for command, each in zip(commands, result["found"].values(), strict=True)
    ]
    return _table(["command", f"{result['frames']} frames", "300 frames"], rows)


def printed(name: str) -> str:
    """Return what a command printed, as a block."""
    return f"```text\n{load(name)['printed']}\n```"


def pcp_table(name: str, methods: list[str] | None = None) -> str:
    """Return a table with the mean PCP, and that of the worst subset, of each method by number of cameras."""
    results = _results(name)
    views = list(dict.fromkeys(count for _, count in results))
    names = methods or list(dict.fromkeys(method for method, _ in results))
    header = ["method", *(f"{count} cameras" + ("" if count == max(views) else ": mean (worst)") for count in views)]
    rows = []
    for method in names:
        cells = []
        for count in views:
            found = results[method, count]
            mean, worst = found["mean"]["pcp"], found["worst"]["pcp"]
            cells.append(f"{mean:.1f}" if count == max(views) else f"{mean:.1f} ({worst:.1f})")
        rows.append([METHODS[method], *cells])
    return _table(header, rows)


def front_table() -> str:
    """Return a table of a few methods on Shelf with intervals: table 2 of the paper, with one capture for all rows."""
    names = {
        "measured": "measured joints only",
        "linear": "straight lines (`linear`)",
        "gaussian_process": "a Gaussian process over similar poses (`gaussian_process`)",
        "dmae_denoise": "**that, corrected by our network: `dmae complete` by default** (`dmae_denoise`)",
        "the paper's network, without fine-tuning": "the paper's network, trained on simulated people",
        "the paper's network, final": "the paper's network, tuned on annotations of other parts of this recording",
    }
    columns = ("views_5", "views_4", "views_3", "worst_3")
    rows = [[words, *(cell("table_2", name, column) for column in columns)] for name, words in names.items()]
    return _table(["method", "5 cameras", "4 cameras", "3 cameras", "worst 3"], rows)


def cell(name: str, row: str, column: str, interval: bool = True) -> str:
    """Return a cell of a row measured here, of a table of the paper."""
    score = _row(name, row, published=False)["cells"][column]
    text = f"{score['value']:.1f}"
    return text if score["low"] is None or not interval else f"{text} ({score['low']:.1f} to {score['high']:.1f})"


def published(name: str, row: str, column: str) -> str:
    """Return a published cell of a table of the paper."""
    return f"{_row(name, row, published=True)['cells'][column]['value']:.1f}"


def _row(name: str, row: str, published: bool) -> dict:
    rows = load(name)["table"]["rows"]
    (found,) = (each for each in rows if each["name"] == row and (each["origin"] == "published") == published)
    return found


def near(detector: str, group: str) -> str:
    """Return the percentage of a detector's joints, hidden or visible as `group`, within 5 % of the height."""
    rows = load("detector_errors")["detectors"][detector]["joints"]
    (found,) = (row["near"] for row in rows if (row["heading"], row["group"]) == ("cause", group))
    return f"{100 * found:.1f}"


def pcp(name: str, method: str, views: int, interval: bool = False) -> str:
    """Return the mean PCP of a method with some cameras, and its 95 % interval if wanted."""
    found = _results(name)[method, views]
    low, high = found["intervals"]["pcp"]
    return f"{found['mean']['pcp']:.1f}" + (f" ({low:.1f} to {high:.1f})" if interval else "")


def held_table(*rows: tuple[str, str, int, str]) -> str:
    """Return a table of the shares of completed joints in their stated 90 % regions, %, with their numbers.

    A row is a results file, a method, a number of cameras, and what people read.
    """
    cells, head = [], []
    for name, method, views, words in rows:
        gaps = _results(name)[method, views]["mean"]["gaps"]
        head = [f"{gap['frames']} frames" for gap in gaps]
        cells.append([words, *(f"{gap['held']:.0f} % of {gap['stated']}" for gap in gaps)])
    return _table(["joints in their 90 % regions", *head], cells)


def dated(name: str) -> str:
    """Return the date on which a results file was measured."""
    return load(name)["date"]


def uncompared() -> str:
    """Return the numbers of completed joints in captured poses' longest gaps, and of those that methods share."""
    tables = load("completion_gains")["tables"]
    completed = tables["regions"]["rows"][2][-1].rpartition(" ")[2]
    (compared,) = (row[2] for row in tables["captured"]["rows"] if row[:2] == ["41 or more", "all"])
    return f"{int(completed) - int(compared)} of {completed} ({100 - 100 * int(compared) / int(completed):.0f} %)"


def found_between(heading: str, group: str) -> str:
    """Return Wilson's 95 % interval of the share of people found in rendered images, as if all were independent."""
    (row,) = (each for each in load("realism")["rows"] if (each["heading"], each["group"]) == (heading, group))
    interval = binomtest(round(row["found"] * row["people"]), row["people"]).proportion_ci(method="wilson")
    return f"{100 * interval.low:.0f} to {100 * interval.high:.0f}"


def told(name: str, pattern: str) -> str:
    """Return what a tutorial printed where a regular expression has its group."""
    return re.search(pattern, tutorials.executed(name)["printed"])[1]


def gaps_table(name: str, methods: list[str] | None = None) -> str:
    """Return a table with the mean error of unmeasured joints, mm, of each method by length of the gap in frames."""
    results = _results(name)
    names = methods or [method for method, _ in results if method != "measured"]
    first = next(iter(results.values()))["mean"]["gaps"]
    rows = []
    for method in names:
        (found,) = (result for (other, _), result in results.items() if other == method)
        errors = [gap["mpjpe"] for gap in found["mean"]["gaps"]]
        rows.append([METHODS[method], *("" if error is None else f"{error:.0f}" for error in errors)])
    return _table(["mm, by frames unmeasured", *(gap["frames"] for gap in first)], rows)


def benchmark_table(name: str, table: str, methods: list[str] | None = None) -> str:
    """Return a table of `dmae benchmark` (`dmae.evaluation.benchmark.page`), of some methods or all."""
    from dmae.evaluation.benchmark.page import benchmark_tables

    scores = load(name)["scores"]
    if methods:
        scores["completion"] = {method: scores["completion"][method] for method in methods}
    found = benchmark_tables(scores)[table]
    return f"{found.caption}:\n\n{_table(list(found.header), [list(row) for row in found.rows])}"


def kept_table(name: str, table: str, without: str | None = None) -> str:
    """Return a table that a results file contains as text: columns, all but one that says nothing, and rows."""
    kept = load(name)["tables"][table]
    shown = [index for index, column in enumerate(kept["columns"]) if column != without]
    header, *rows = ([row[index] for index in shown] for row in (kept["columns"], *kept["rows"]))
    return _table(header, rows)


def contacts_table(name: str) -> str:
    """Return a table of interactions: how often and how hard people touch, as `synth stats` counts."""
    from synth.datasets.statistics import CONTACT_HEAD, contact_rows

    return _table(list(CONTACT_HEAD), [list(row) for row in contact_rows(load(name)["contacts"])])


def motion_table(names: dict[str, str]) -> str:
    """Return a table of comparisons by `synth compare by=motion`: distances of generated from recorded motion."""
    rows = []
    for name, words in names.items():
        ratios = [each["wasserstein"] / each["halves_wasserstein"] for each in load(name)["differences"]]
        far = sum(ratio > 2 for ratio in ratios)
        rows.append([words, f"{far} of {len(ratios)}", f"{sorted(ratios)[len(ratios) // 2]:.1f}", f"{max(ratios):.1f}"])
    return _table(["motion", "distances over 2", "median", "greatest"], rows)


def realism_table(name: str, headings: list[str]) -> str:
    """Return a table with the rows of `synth realism` under some headings."""
    from synth.recognition.realism import HEAD, Rate, described

    rows = [Rate(**row) for row in load(name)["rows"]]
    return _table(list(HEAD), [list(described(row)) for row in rows if row.heading in headings])


def errors_table(name: str, of: str, column: str, headings: list[str]) -> str:
    """Return a table of `synth detector-errors`, %: a row for each group, a column for each detector."""
    detectors = load(name)["detectors"]
    keyed = {
        detector: {(row["heading"], row["group"]): row for row in each[of]} for detector, each in detectors.items()
    }
    first = next(iter(keyed.values()))
    rows = [
        [f"{heading}: {group}" if group else heading, str(row[of]),
         *("-" if (found := each.get((heading, group), {}).get(column)) is None else f"{100 * found:.1f}"
           for each in keyed.values())]
        for (heading, group), row in first.items()
        if heading in headings
    ]  # fmt: skip
    return _table([of, "number", *detectors], rows)


def distances_table(name: str) -> str:
    """Return a table of the distances of a preset with limits, on the clips of the fit and on held-back clips, and of
    the detector's own distances between both."""
    found = load(name)
    others = [{row["what"]: row for row in found[which]} for which in ("held_back", "real")]
    rows = []
    for row in found["fitted"]:
        if row["allowed"] is not None and row["what"] != "missed: small_toe":
            each = [row, *(other.get(row["what"], {}) for other in others)]
            cells = [f"{one['distance']:.3f}" if one.get("distance") is not None else "-" for one in each]
            rows.append([row["what"], *cells, f"{row['allowed']:.2f}"])
    return _table(
        ["distance", "preset, clips of the fit", "preset, held back", "detector, fit to held back", "wanted"], rows
    )


def paper_table(name: str) -> str:
    """Return a table of the paper with its notes, as `dmae table` writes it."""
    from dmae.evaluation.paper_tables.layout import markdown

    return markdown(load(name)["table"]).rstrip()


def protocols() -> str:
    """Return a table of the PCP protocols with their rules."""
    from dmae.metrics.registry import protocol

    rows = [
        [f"`{name}`", rules.help, "counts as wrong" if rules.missed_count else "does not count",
         "correct" if rules.at_half else "wrong", f"`{rules.head}`"]
        for name, rules in protocol.items()
    ]  # fmt: skip
    return _table(["", "assignment", "a person without a prediction", "a limb off by half", "head"], rows)


def stress_table(name: str, figure: str = "pcp") -> str:
    """Return a table of breaking points, by `pcp` or by the error of `hidden` joints: corruptions by methods."""
    from dmae.evaluation.stress.page import breaking_tables

    table = breaking_tables(load(name)["stress"])[["pcp", "hidden"].index(figure)]
    return _table(list(table.header), [list(row) for row in table.rows])


def reliability_table(name: str) -> str:
    """Return a table of stated confidence and share of joints near their place, by confidence and kind of joint."""
    rows = [
        [each["joints"], str(each["number"]), *(f"{100 * each[key]:.1f}" for key in ("confidence", "near", "error"))]
        for each in load(name)["rows"]
    ]
    return _table(["joints", "number", "mean confidence, %", "within 5 % of the height, %", "apart, %"], rows)


def origin(name: str, table: str | None = None) -> str:
    """Return a line with the command, date and commit that made a results file."""
    found = load(name)
    command = found["tables"][table]["command"] if table else found["command"]
    made = (
        found["tables"][table].get("measured", found["measured"])
        if table
        else f"{found['date']}, commit {found['commit']}, {found['versions']}"
    )
    file = f"docs/results/{name}.json"
    # Two variables of a shell in one command would be read as an equation.
    command = html.escape(command).replace("$", "&#36;")
    return f"<sub><code>{command}</code><br>measured {made}; file <code>{file}</code></sub>"


def _results(name: str) -> dict[tuple[str, int], dict]:
    results = load(name)["scores"]["results"]
    return {(found["method"], found["views"]): found for found in results}


def _table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def functions(*modules: str) -> str:
    """Return a table of the functions of modules."""
    import reference

    return reference.functions(*modules)


def types(*names: str) -> str:
    """Return a table of classes."""
    import reference

    return reference.types(*names)


_FUNCTIONS = {
    each.__name__: each
    for each in (
        value, values_table, memory_table, printed, pcp_table, front_table, cell, published, near, pcp,
        held_table, dated, told, uncompared, found_between, gaps_table, kept_table, origin, realism_table,
        errors_table, reliability_table, distances_table, contacts_table, motion_table, paper_table,
        benchmark_table, protocols, stress_table, functions, types,
    )
}  # fmt: skip


def evaluated(expression: str) -> str:
    """Return the value of an expression in a page, as text."""
    return str(eval(expression.strip(), {"__builtins__": {}}, _FUNCTIONS))  # the project's own pages
