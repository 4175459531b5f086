"""What did the user mean? The name nearest to a mistyped one, and what messages say of it."""

from collections.abc import Collection, Iterable
from difflib import get_close_matches


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Return the most similar of some words, in any case of letters; None if none is similar."""
    folded = {each.lower(): each for each in words}
    return next((folded[each] for each in get_close_matches(word.lower(), folded, 1)), None)


def suggestion(word: str, words: Collection[str]) -> str:
    """Return the text for an unknown word: the nearest one, or all of them if none is near."""
    near = nearest(word, words)
    return f"did you mean {near}?" if near else f"there are {', '.join(words)}"


def choices(word: str, words: Collection[str]) -> str:
    """Return the text for an unknown choice: the nearest one, and all of them."""
    near = nearest(word, words)
    return f"{f'did you mean {near}? There' if near else 'there'} are {', '.join(words)}"


def unknown(kind: str, name: str, known: Collection[str]) -> str:
    """Return the message for a name that is not known."""
    return f"no {kind} {name!r}; {choices(name, known)}"
