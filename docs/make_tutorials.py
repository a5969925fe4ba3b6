"""Make the figures of two tutorials: run the commands and the Python of a page, and keep pictures.

python docs/make_tutorials.py rocket-stage
python docs/make_tutorials.py ariadne 43_Ariadne.lcs      what the page takes for granted
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import lcbayes

DOCS = Path(__file__).parent
BLOCK = re.compile(r"(?ms)^```(sh|python)\n(.*?)^```$")
FIGURES = {  # of a page: where its commands write it, and its name in `docs/figures`
    "rocket-stage": {
        "look/figures/folded.svg": "rocket-stage-folded.svg",
        "scan/figures/sky.svg": "rocket-stage-sky.svg",
    },
    "ariadne": {
        "spins/figures/periods.svg": "ariadne-periods.svg",
        "ariadne/figures/shape-1.svg": "ariadne-shape.svg",
    },
}
DRAWN = {  # those with many points, as PNG: the results folder and the method of its result
    "rocket-stage": ("out", "plot_light_curve", "rocket-stage-fit.png"),
    "ariadne": ("ariadne", "plot_model_curves", "ariadne-curves.png"),
}
TRUSTED_OR_NOT = (0, 3)


def commands(page: str) -> list[list[str]]:
    """What a page runs, in order, for this interpreter."""
    found = []
    for language, text in BLOCK.findall(page):
        if language == "python":
            found.append([sys.executable, "-c", text])
        else:
            lines = text.replace("\\\n", " ").splitlines()
            found += [[sys.executable, "-m", *shlex.split(line, comments=True)] for line in lines]
    return found


def main(name: str, files: Sequence[str], out: Path = DOCS / "figures") -> None:
    """Write the figures of a page.

    Parameters
    ----------
    name : name of the page
    files : files of observations that its commands name
    """
    page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch:
        for file in files:
            shutil.copy(file, scratch)
        for command in commands(page):
            status = subprocess.run(command, cwd=scratch).returncode
            if status not in TRUSTED_OR_NOT:
                sys.exit(f"exit status {status}: {shlex.join(command)}")
        for file, figure in FIGURES[name].items():
            shutil.copy(Path(scratch) / file, out / figure)
        folder, method, figure = DRAWN[name]
        first = getattr(lcbayes.load(Path(scratch) / folder), method)()[0]
        first.savefig(out / figure, dpi=130)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
