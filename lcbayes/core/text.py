"""Text for messages."""

from __future__ import annotations

from collections.abc import Iterable


def join_words(words: Iterable[str], last_by: str = "and") -> str:
    """A list of words joined with commas, the last by "and" or another word.

    Examples
    --------
    >>> join_words(["a", "b", "c"])
    'a, b and c'
    """
    *first, last = words
    return f"{', '.join(first)} {last_by} {last}" if first else last


def probability(value: float) -> str:
    """A probability that is never written as certain, or as none.

    Examples
    --------
    >>> probability(0.86312), probability(0.999999), probability(2e-9)
    ('0.863', 'above 0.9999', 'below 0.0001')
    """
    if value < 0.0001:
        return "below 0.0001"
    return "above 0.9999" if value > 0.9999 else f"{value:.3g}" if value < 0.99 else f"{value:.4f}"


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
