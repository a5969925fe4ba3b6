"""The site that holds the pages of several versions."""

from __future__ import annotations

import functools
import json
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from docs import make_site

PAGE = '<html lang="en"><head></head><body><a class="sidebar-brand">{}</a></body></html>'


def built(folder: Path, version: str, *pages: str) -> Path:
    """Made-up pages, as if Sphinx had built them in a folder."""
    for name in ("index", "api/fit", *pages):
        page = folder / f"{name}.html"
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(PAGE.format(f"{name} of {version}"), "utf-8")
    head = f"# Sphinx inventory version 2\n# Project: lcbayes\n# Version: {version}\n"
    (folder / "objects.inv").write_bytes(head.encode() + b"# The remainder\n\x78\x9c\xff")
    return folder


@pytest.fixture
def publish(tmp_path):
    """Publish made-up pages of a version in `tmp_path / "site"`."""

    def run(version: str, name: str | None = None, pages: tuple[str, ...] = ()) -> Path:
        html = built(tmp_path / f"{version}-{len(pages)}", version, *pages)
        make_site.publish(html, tmp_path / "site", name)
        return tmp_path / "site"

    return run


def listed(site: Path) -> dict[str, str]:
    versions = json.loads((site / "versions.json").read_text("utf-8"))
    script = (site / "versions.js").read_text("utf-8")
    assert script.startswith(f"const versions = {json.dumps(versions, indent=1)};\n")
    return {one["name"]: one["status"] for one in versions}


def leads_to(site: Path) -> str | None:
    _, _, rest = (site / "index.html").read_text("utf-8").partition("; url=")
    return rest.partition('"')[0] or None


def test_versions_stand_side_by_side(publish):
    site = publish("1.9.0")
    assert listed(site) == {"1.9.0": "newest"}
    publish("1.10.0")
    assert list(listed(site).items()) == [("1.10.0", "newest"), ("1.9.0", "older")]
    assert leads_to(site) == "1.10.0/index.html"
    for version in ("1.9.0", "1.10.0"):
        page = (site / version / "index.html").read_text("utf-8")
        assert f"index of {version}" in page
        assert '<script src="../versions.js" defer></script>' in page
        page = (site / version / "api" / "fit.html").read_text("utf-8")
        assert page.count('<script src="../../versions.js" defer></script>') == 1
        assert f'href="{version}/index.html"' in (site / "index.html").read_text("utf-8")
    publish("1.9.1")  # a correction of an older release
    assert leads_to(site) == "1.10.0/index.html"


def test_nothing_but_a_release_is_first(publish):
    site = publish("1.0.0", "dev")
    assert leads_to(site) is None
    assert 'href="dev/index.html"' in (site / "index.html").read_text("utf-8")
    publish("0.9.0")
    publish("1.0.0rc1")
    assert listed(site) == {"0.9.0": "newest", "dev": "unreleased", "1.0.0rc1": "unreleased"}
    assert leads_to(site) == "0.9.0/index.html"


def test_published_again(publish):
    site = publish("1.0.0", pages=("gone",))
    publish("1.0.0")
    assert not (site / "1.0.0" / "gone.html").exists()
    assert sorted(path.name for path in site.iterdir() if path.is_dir()) == ["1.0.0"]
    assert listed(site) == {"1.0.0": "newest"}


def test_faults_are_said_in_a_line(tmp_path, monkeypatch, capsys):
    site = tmp_path / "site"
    monkeypatch.setattr(make_site, "HTML", tmp_path / "html")
    with pytest.raises(SystemExit, match=r"html has no built pages; run make docs first$"):
        make_site.main([str(site)])
    assert not site.exists()
    built(tmp_path / "html", "1.0.0")
    with pytest.raises(SystemExit, match=r"'\.\./other' cannot be a folder"):
        make_site.main([str(site), "../other"])
    (site / "photographs").mkdir(parents=True)
    with pytest.raises(SystemExit, match=r"photographs exists and is no version of the pages"):
        make_site.main([str(site), "photographs"])
    make_site.main([str(site)])
    assert capsys.readouterr().out == f"site: {site / 'index.html'}\n"


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format, *args):
        pass


@pytest.fixture
def server(tmp_path):
    """Address of the site on a server."""
    handler = functools.partial(Quiet, directory=str(tmp_path / "site"))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as running:
        thread = threading.Thread(target=running.serve_forever, args=(0.05,))
        thread.start()
        yield f"http://127.0.0.1:{running.server_port}"
        running.shutdown()
        thread.join()


@pytest.mark.slow
def test_the_menu(publish, server, browser):
    publish("1.9.0", pages=("old",))
    site = publish("1.10.0")
    context = browser.new_context()
    tab = context.new_page()

    def choose(address: str, version: str) -> str:
        tab.goto(address)
        menu = tab.get_by_label("Version of these pages")
        assert menu.locator("option:checked").text_content() == "1.9.0 (older)"
        menu.select_option(version)
        tab.wait_for_url(f"**/{version}/**")
        return tab.url

    fit = f"{server}/1.9.0/api/fit.html#bounds"
    assert choose(fit, "1.10.0") == f"{server}/1.10.0/api/fit.html#bounds"
    assert choose(f"{server}/1.9.0/old.html", "1.10.0") == f"{server}/1.10.0/index.html"
    file = (site / "1.9.0" / "api" / "fit.html").as_uri()
    assert choose(file, "1.10.0") == (site / "1.10.0" / "index.html").as_uri()
    tab.goto((site / "index.html").as_uri())
    tab.wait_for_url("**/1.10.0/index.html")
    context.close()
