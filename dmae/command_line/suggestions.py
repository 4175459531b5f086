"""Suggest what a user probably meant by an unknown option, command or choice."""

from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches

from dmae.command_line.options import Group

_CONFUSED = {"clip": "data", "data": "clip"}
"""Options that one command has under the first name, and another command under the second."""


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Return the most similar of some words; None if none is similar."""
    found = get_close_matches(word, list(words), 1, 0.6)
    return found[0] if found else None


def suggestion(word: str, words: Iterable[str], what: str = "there are") -> str:
    """Return the text for an unknown word: the nearest known words, or all of them if none is near."""
    words = list(words)
    near = nearest(word, words)
    return f"did you mean {near}?" if near else f"{what} {', '.join(words)}"


def choices(value: str, known: Iterable[str]) -> str:
    """Return the text for an unknown choice: the nearest one, and all of them."""
    near = nearest(value, known)
    return f"did you mean {near}? There are {', '.join(known)}" if near else f"there are {', '.join(known)}"


def like(options: Group, key: str) -> str:
    """Return the text for an unknown option: the option with the same last name, or else the most similar one."""
    keys = [member.key for member in options.walk() if not key.startswith(f"{member.key}.")]
    if _CONFUSED.get(key) in keys:
        return f"did you mean {_CONFUSED[key]}?"
    last = key.rpartition(".")[2]
    same = [each for each in keys if each.rpartition(".")[2] == last]
    if len(same) > 1:
        same = [nearest(key, same) or ""] if nearest(key, same) else same
    if len(same) == 1:
        return f"did you mean {same[0]}?"
    if same:
        return f"did you mean one of {', '.join(same[:6])}?"
    lasts = {each.rpartition(".")[2]: each for each in reversed(keys)}
    similar = {near: SequenceMatcher(None, key, near).ratio() for near in [nearest(key, keys)] if near}
    similar |= {lasts[near]: SequenceMatcher(None, last, near).ratio() for near in [nearest(last, lasts)] if near}
    if similar:
        return f"did you mean {max(similar, key=similar.get)}?"
    return f"there are {', '.join(member.key for member in options.members)}"


def meant(options: Group, word: str, required: Iterable[str] = ()) -> str:
    """Return the text for a word without `=`: the option of this or a similar name, or else one that takes a path.

    Args:
        options: Options of the command.
        word: As the user typed it.
        required: Options that must be given; the first of them probably has the word as its value.
    """
    keys = [member.key for member in options.walk()]
    if near := word if word in keys else nearest(word, keys):
        return f", as in {near}=..."
    value_of = next((key for key in (*required, "clip", "data") if key in keys), None)
    return f", as in {value_of}={word}" if value_of else ""
