"""Make the figure of `asteroid-size.md`.

python docs/make_asteroid_size.py FIT CHORDS   a fit of an asteroid and its occultation chords
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import lcbayes

OUT = Path(__file__).parent / "figures" / "asteroid-outline.svg"


def main(fit: Path, chords: Path, out: Path = OUT, **options: int) -> None:
    """Write the outlines of each solution over the chords, 180 mm wide, as SVG.

    Parameters
    ----------
    fit : results folder of a fit
    chords : file of an occultation
    **options
        Other options of `lcbayes.predict`.
    """
    result = lcbayes.predict(fit, occultation=chords, **options)
    with tempfile.TemporaryDirectory() as scratch:
        result.report(scratch)
        shutil.copy(Path(scratch) / "figures" / "outlines-2-columns.svg", out)
    print(result.text())


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
