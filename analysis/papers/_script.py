"""The common parts of the figure scripts: the command line and the output of figures."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from lcbayes.analysis import style


def parser(doc: str, draws: int | None = None) -> argparse.ArgumentParser:
    """Options -o and --seed (and --draws), with an example in --help; ``doc`` is the script's
    docstring."""
    name = Path(sys.argv[0]).name
    made = argparse.ArgumentParser(
        description=doc,
        epilog=f"example: python analysis/papers/{name} -o figures --seed 1",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument(
        "-o", "--out", type=Path, default=Path("figures"), metavar="DIR", help="default: figures"
    )
    made.add_argument(
        "--seed", type=int, default=1, help="of the noise and of the sampler (default: 1)"
    )
    if draws is not None:
        made.add_argument(
            "--draws", type=int, default=draws, help=f"of the posterior (default: {draws})"
        )
    return made


def figure(width: float, height: float) -> Any:
    """A figure in the style of the reports, with size in inches, drawn without a display."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update(style.RC)
    return plt.figure(figsize=(width, height), layout="constrained")


def save(made: Any, folder: Path, name: str) -> None:
    """Write ``name``.png and ``name``.svg to the folder and print their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for ending, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        made.savefig(folder / f"{name}.{ending}", dpi=200, metadata=metadata)
    print(folder / f"{name}.png")
