"""Text for messages."""

from __future__ import annotations

from collections.abc import Iterable


def join_words(words: Iterable[str]) -> str:
    """A list of words joined with commas and "and".

    Examples
    --------
    >>> join_words(["a", "b", "c"])
    'a, b and c'
    """
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def closest(word: str, names: Iterable[str]) -> str:
    """A question that offers the most similar name, or an empty string.

    Examples
    --------
    >>> closest("--n-facet", ["--seed", "--n-facets"])
    ' (did you mean --n-facets?)'
    """
    from difflib import get_close_matches

    similar = get_close_matches(word, list(names), n=1)
    return f" (did you mean {similar[0]}?)" if similar else ""
