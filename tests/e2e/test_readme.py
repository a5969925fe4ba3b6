"""What README and docs show as Python runs as it is, with fewer draws than a reader would take."""

import functools
import re
from pathlib import Path

import pytest

import lcbayes

ROOT = Path(__file__).parents[2]
FEW = {"num_warmup": 50, "num_samples": 50, "num_chains": 2, "num_starts": 4, "max_modes": 1}


def blocks(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.S)


@pytest.fixture
def few(monkeypatch):
    monkeypatch.setattr(lcbayes, "fit", functools.partial(lcbayes.fit, **FEW), raising=False)


@pytest.mark.usefixtures("few")
def test_the_example_of_the_readme_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (example,) = blocks("README.md")
    assert len(example.strip().splitlines()) <= 12
    names: dict = {}
    exec(compile(example, "README.md", "exec"), names)
    assert "Fit(faceted, 155 points" in capsys.readouterr().out
    assert names["fit"].posterior.sizes["facet"] == 6
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.usefixtures("few")
def test_the_model_file_of_the_docs_fits(tmp_path):
    (example,) = blocks("docs/models.md")
    file = tmp_path / "mine.py"
    file.write_text(example, encoding="utf-8")
    scenarios = ROOT / "lcbayes" / "scenarios"
    curve = lcbayes.read(scenarios / "box-wing.csv", tle=scenarios / "box-wing.tle")
    fit = lcbayes.fit(curve, model=str(file), log_mean=0.5)
    row = fit.summary()["parameters"]["size"]
    assert 1.0 < row["mean"] < 20.0  # the truth has albedo-areas of 9.4 m² in all
    assert not fit.converged  # a sphere cannot explain a tumbling satellite, and the fit says so


def test_commands_of_the_pages_exist():
    from lcbayes import cli

    text = "".join(
        p.read_text(encoding="utf-8") for p in [ROOT / "README.md", *ROOT.glob("docs/*.md")]
    )
    named = set(re.findall(r"(?m)(?:^|`)lcbayes ([a-z]+(?:-[a-z]+)*)\b", text))
    assert {"fit", "predict", "simulate"} <= named
    assert named <= set(cli.COMMANDS), named - set(cli.COMMANDS)


def test_links_of_the_pages_lead_somewhere():
    for page in [ROOT / "README.md", *ROOT.glob("docs/*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), (page.name, target)
