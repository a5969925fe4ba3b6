"""What `lcbayes doctor` finds wrong with an installation."""

from __future__ import annotations

import json
from importlib import metadata

import pytest

from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE
from lcbayes.tasks.doctor import run as doctor


def checks(capsys) -> dict[str, dict[str, str]]:
    return {one["name"]: one for one in json.loads(capsys.readouterr().out)["checks"]}


def test_a_missing_and_an_old_package_are_named(monkeypatch, capsys):
    version = metadata.version

    def changed(name: str) -> str:
        if name == "sgp4":
            raise metadata.PackageNotFoundError(name)
        return "0.0.1" if name == "arviz" else version(name)

    monkeypatch.setattr(metadata, "version", changed)
    assert main(["doctor", "--json"]) == EXIT_BAD_INPUT
    named = checks(capsys)
    assert named["sgp4"]["found"] == "missing"
    assert named["sgp4"]["remedy"].startswith("run: pip install 'sgp4")
    assert named["arviz"]["remedy"].startswith("run: pip install 'arviz>=")
    assert named["numpy"]["remedy"] == ""


def test_a_package_that_is_not_installed_is_named(monkeypatch):
    def none(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", none)
    (only,) = doctor._packages()
    assert (only.name, only.found) == ("lcbayes", "not installed")


def test_folders_that_cannot_be_used_are_named(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    assert "LCBAYES_CACHE" in doctor._cache(tmp_path / "file" / "cache").remedy
    assert doctor._cache(None).remedy == ""
    assert doctor._cache(tmp_path / "cache").remedy == ""
    monkeypatch.setenv("LCBAYES_DATA", str(tmp_path / "file"))
    assert doctor._data().found.endswith("is not a folder")
    monkeypatch.setenv("LCBAYES_DATA", str(tmp_path))
    assert doctor._data().remedy == ""


@pytest.mark.parametrize(("gib", "needs"), [(1.0, True), (8.0, False)])
def test_little_memory_is_named(monkeypatch, gib, needs):
    sizes = {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": gib * 2**30 / 4096}
    monkeypatch.setattr(doctor.os, "sysconf", sizes.get)
    assert doctor._memory().remedy == ("fits need some 2 GiB" if needs else "")


def test_the_lines_end_with_a_count(monkeypatch, capsys):
    wrong = [doctor.Check("one", "1"), doctor.Check("two", "2", "mend it")]
    monkeypatch.setattr(doctor, "examine", lambda: iter(wrong))
    assert main(["doctor"]) == EXIT_BAD_INPUT
    assert capsys.readouterr().out.splitlines() == [
        "one  1",
        "two  2  <- mend it",
        "1 of 2 checks need attention",
    ]
    monkeypatch.setattr(doctor, "examine", lambda: iter(wrong[:1]))
    assert main(["doctor"]) == EXIT_DONE
    assert capsys.readouterr().out.endswith("all is well\n")
