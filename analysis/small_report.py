"""A folder of results without a posterior: numbers, words and figures, put in place together."""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.analysis.pages import environment
from lcbayes.analysis.style import Gallery, drawing
from lcbayes.core.errors import InputError
from lcbayes.core.files import write_json
from lcbayes.core.version import installed_version
from lcbayes.results.folder import put_in_place

if TYPE_CHECKING:
    from lcbayes.results.result import Result

UNTRUSTED = "NOT to be trusted"


def write(
    folder: Path,
    name: str,
    content: Mapping[str, Any],
    lines: Sequence[str],
    draw: Callable[[Gallery], None],
    texts: Mapping[str, str | None] | None = None,
    refused: str = UNTRUSTED,
) -> None:
    """Write ``name``.json, ``name``.txt, ``name``.html and `figures/`, made aside, then put in
    place.

    Parameters
    ----------
    content : mapping
        Of the JSON file; a number that is none becomes null. It has "curve", "n_obs" and "reasons".
    lines : of the text file
    draw : puts its figures into the gallery it is given
    texts : file name → content
        Further files; None removes what an earlier run left.
    refused : what heads the reasons, where there are some
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=folder))
    except OSError as fault:
        raise InputError(
            f"{folder} cannot be written ({fault.strerror}); choose another with -o"
        ) from None
    try:
        figures = scratch / "figures"
        figures.mkdir(mode=0o755)
        write_json(content, scratch / f"{name}.json")
        (scratch / f"{name}.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
        with drawing():
            gallery = Gallery(figures)
            draw(gallery)
        page = (
            environment()
            .get_template("small.html.j2")
            .render(
                title=Path(content["curve"]).name,
                what=name.replace("_", " "),
                name=name,
                refused=refused[:1].upper() + refused[1:],
                content=content,
                # the verdict on top of the page has the reasons already
                lines=[x for x in lines if not any(x.endswith(why) for why in content["reasons"])],
                images=gallery.images,
                version=installed_version(),
            )
        )
        (scratch / f"{name}.html").write_text(page, encoding="utf-8")
        for file, text in (texts or {}).items():
            (folder / file).unlink(missing_ok=True)
            if text is not None:
                (scratch / file).write_text(text, encoding="utf-8")
        put_in_place(scratch, folder)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def write_page(
    folder: Path,
    result: Result,
    draw: Callable[[Gallery], None],
    refused: str = UNTRUSTED,
) -> None:
    """Write ``report.html`` and ``figures/`` of a result without a posterior.

    Parameters
    ----------
    folder : where the numbers are
    draw : puts its figures into the gallery it is given
    refused : heading of the reasons, where there are some
    """
    figures = folder / "figures"
    figures.mkdir()
    with drawing():
        gallery = Gallery(figures)
        draw(gallery)
    content = result.content
    page = (
        environment()
        .get_template("small.html.j2")
        .render(
            title=Path(str(content.get("curve", ""))).name or result.task,
            what=result.task.replace("-", " "),
            refused=refused[:1].upper() + refused[1:],
            content=content | {"reasons": [reason.text for reason in result.reasons]},
            lines=result.lines(),
            images=gallery.images,
            version=installed_version(),
        )
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def tell(folder: Path, name: str, lines: Sequence[str], as_json: bool) -> None:
    """Print the lines and where the page is, or the JSON file alone."""
    if as_json:
        json.dump(
            json.loads((folder / f"{name}.json").read_text(encoding="utf-8")), sys.stdout, indent=1
        )
        print()
    else:
        print("\n".join(lines))
        print(f"\nreport: {folder / name}.html")
