"""What a search has done so far, kept in the checkpoint of its run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lcbayes.core.checkpoint import Arrays, Checkpoint


@dataclass(frozen=True)
class Saved:
    """Named arrays of a search in a checkpoint; without a folder nothing is kept.

    Attributes
    ----------
    checkpoint : Checkpoint
    prefix : str
        Of all names.
    """

    checkpoint: Checkpoint = field(default_factory=lambda: Checkpoint(None, {}))
    prefix: str = "search-"

    def within(self, name: str) -> Saved:
        """The part of a search that has a name."""
        return replace(self, prefix=f"{self.prefix}{name}-")

    def load(self, name: str) -> Arrays | None:
        """The arrays of a name, or None."""
        return self.checkpoint.load(self.prefix + name)

    def save(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Keep arrays or numbers, in place of those of the same name."""
        self.checkpoint.save(self.prefix + name, {k: np.asarray(v) for k, v in arrays.items()})

    def once[T](self, name: str, kind: Callable[..., T], compute: Callable[[], T]) -> T:
        """A named tuple of arrays as kept, or computed and kept."""
        stored = self.load(name)
        if stored is not None:
            return kind(**stored)
        found = compute()
        self.save(name, found._asdict())  # pyright: ignore[reportAttributeAccessIssue]
        return found
