"""Put the pages that `make docs` built into a site that holds those of several versions.

    python docs/make_site.py FOLDER [NAME]

The pages go to `FOLDER/NAME`, where they replace those of that name; NAME is by default the version
that they describe. The other versions stay as they are. `FOLDER/index.html` leads to the newest
release, `versions.json` lists all versions, and `versions.js` shows the list on each page. It is a
script, because a browser that reads the site from a disk loads no JSON.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
HTML = DOCS / "_build" / "html"
INVENTORY = "objects.inv"  # of the pages' names; Sphinx writes it at the end of a build
RELEASE = re.compile(r"\d+(\.\d+)*")
SIDEBAR = 'class="sidebar-brand'  # no page has it but those that Sphinx made


def version_of(html: Path) -> str:
    """The version that built pages describe."""
    inventory = html / INVENTORY
    if not inventory.is_file():
        sys.exit(f"{html} has no built pages; run make docs first")
    return inventory.read_bytes().split(b"\n# Version: ")[1].split(b"\n")[0].decode()


def copy(html: Path, folder: Path) -> None:
    """Copy pages to a version's folder, with a line that loads the list of versions."""
    if folder.exists() and not (folder / INVENTORY).is_file():
        sys.exit(f"{folder} exists and is no version of the pages; give another name")
    new = folder.with_name(f".{folder.name}.new")  # the old pages stay until the new are complete
    shutil.rmtree(new, ignore_errors=True)
    shutil.copytree(html, new)
    for page in new.rglob("*.html"):
        text = page.read_text("utf-8")
        if SIDEBAR in text:
            up = "../" * len(page.relative_to(new).parents)
            line = f'<script src="{up}versions.js" defer></script>\n</head>'
            page.write_text(text.replace("</head>", line, 1), "utf-8")
    if folder.exists():
        shutil.rmtree(folder)
    new.rename(folder)


def order(name: str) -> tuple[bool, list[int], str]:
    """Releases by their numbers, after all else."""
    release = RELEASE.fullmatch(name) is not None
    return release, [int(part) for part in name.split(".")] if release else [], name


def versions(site: Path) -> list[dict[str, str]]:
    """The versions of a site, the newest release first, those that are no releases last."""
    names = [path.parent.name for path in site.glob(f"[!.]*/{INVENTORY}")]
    listed: list[dict[str, str]] = []
    for name in sorted(names, key=order, reverse=True):
        release = "older" if listed else "newest"
        listed.append({"name": name, "status": release if order(name)[0] else "unreleased"})
    return listed


def first_page(listed: list[dict[str, str]]) -> str:
    """The page that leads to the newest release, and has a link to every version."""
    to = [f"{one['name']}/index.html" for one in listed]
    lead = ""
    if listed[0]["status"] == "newest":
        lead = f'<meta http-equiv="refresh" content="0; url={to[0]}">\n'
    links = "".join(
        f'<li><a href="{link}">{one["name"]}</a> ({one["status"]})</li>\n'
        for one, link in zip(listed, to, strict=True)
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{lead}<title>lcbayes</title>\n</head>\n<body>\n<h1>Documentation of lcbayes</h1>\n"
        f"<ul>\n{links}</ul>\n</body>\n</html>\n"
    )


def publish(html: Path, site: Path, name: str | None = None) -> None:
    """Put built pages into a site."""
    version = version_of(html)
    name = name or version
    if not re.fullmatch(r"\w[\w.+-]*", name, re.ASCII):
        sys.exit(f"{name!r} cannot be a folder; a name has letters, digits and . + - _")
    site.mkdir(parents=True, exist_ok=True)
    copy(html, site / name)
    listed = versions(site)
    text = json.dumps(listed, indent=1)
    script = (DOCS / "versions.js").read_text("utf-8")
    (site / "versions.json").write_text(text + "\n", "utf-8")
    (site / "versions.js").write_text(f"const versions = {text};\n{script}", "utf-8")
    (site / "index.html").write_text(first_page(listed), "utf-8")
    (site / ".nojekyll").touch()  # some hosts leave out folders such as _static without it


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("site", type=Path, help="folder of the site")
    parser.add_argument("name", nargs="?", help="folder of this version, such as dev")
    given = parser.parse_args(arguments)
    publish(HTML, given.site, given.name)
    print(f"site: {given.site.resolve() / 'index.html'}")


if __name__ == "__main__":
    main()
