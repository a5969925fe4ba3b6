"""`lcbayes look` from a file to its page: satellites, asteroids, twenty points, no directions."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import lcbayes
from benchmarks import _asteroids as asteroids
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, InputError
from lcbayes.simulation.scenarios import bundled
from lcbayes.tasks.look.advice import BODY_EPOCH_S, BODY_S, SPIN_S, advise, fit_cost
from tests.helpers.low_earth_orbit import spinner, steady

RESULTS = {"summary.json", "report.html", "run.toml", "figures", "tables", ".lock"}


@pytest.fixture
def bare(tmp_path):
    """Twenty points of one pass, without errors, directions or date."""
    path = tmp_path / "bare.csv"
    rows = [f"{3 * i},{8 + 0.1 * (i % 4)}" for i in range(20)]
    path.write_text("\n".join(["t,mag", *rows]) + "\n", encoding="utf-8")
    return path


def test_a_spinning_satellite(tmp_path, capsys, look):
    curve, truth = spinner(2013, 4, 50.0, "cylinder")
    lcbayes.write(curve, tmp_path / "passes.csv")
    out = tmp_path / "out"
    assert main.main(["look", str(tmp_path / "passes.csv"), "-o", str(out)]) == EXIT_DONE
    output = capsys.readouterr().out
    assert re.search(r"points +\d+ in \d+ passes", output)
    assert "errors       given, median" in output
    content = json.loads((out / "summary.json").read_text())
    assert (content["task"], content["trusted"], content["n_obs"]) == ("look", True, curve.n_obs)
    turns = [truth["period"] / one["period_s"] for one in content["periods"]["listed"]]
    assert turns[0] == pytest.approx(round(turns[0]), rel=0.02)  # a whole number in a rotation
    assert {p.name for p in out.iterdir()} == RESULTS
    assert {p.stem for p in (out / "tables").iterdir()} == {"commands", "passes", "periods"}
    assert {p.stem for p in (out / "figures").glob("*.svg")} == {
        "light-curve",
        "phase-angle",
        "periodogram",
        "folded",
    }
    commands = {one["command"].split()[1]: one for one in content["commands"]}
    assert commands["spin"]["suits"]
    assert sum(one["n_obs"] for one in content["passes"]) == curve.n_obs
    look(out / "report.html", turning=1)


def test_the_commands_can_be_pasted(capsys):
    folder = bundled()["box-wing"].parent
    argv = ["look", str(folder / "box-wing.csv"), "--tle", str(folder / "box-wing.tle"), "--json"]
    assert main.main(argv) == EXIT_DONE
    content = json.loads(capsys.readouterr().out)
    assert content["orbit"]
    assert content["sites"] == {"Calar Alto": 70, "Zimmerwald": 85}
    for one in content["commands"]:
        words = shlex.split(one["command"])
        args = main._parser().parse_args(words[1:])
        assert args.tle == str(folder / "box-wing.tle")
        assert (one["cost_s"] is not None) == one["suits"]
    fits = {
        one["command"].split()[4]: one for one in content["commands"] if " fit " in one["command"]
    }
    assert fits["2"]["cost_s"] == pytest.approx(SPIN_S + fit_cost(155, 2))


def test_twenty_points_without_directions(bare, tmp_path, capsys, look):
    assert main.main(["look", str(bare)]) == EXIT_DONE
    output = capsys.readouterr().out
    assert "none: no directions to Sun and observer" in output
    assert "not searched: no pass has 30 points" in output
    assert "--tle object.tle --site" in output
    assert "# epoch_jd" in output
    assert not (tmp_path / "out").exists()
    assert main.main(["look", str(bare), "-o", str(tmp_path / "out")]) == EXIT_DONE
    look(tmp_path / "out" / "report.html", turning=1)


def test_other_tasks_refuse_a_curve_without_directions(bare, tmp_path, capsys):
    assert main.main(["fit", str(bare), "-o", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert "has no geometry; expected sun_x" in capsys.readouterr().err
    curve = lcbayes.read(bare, geometry=False)
    assert curve.brightness_only
    assert np.isnan(curve.phase_angle).all()
    with pytest.raises(InputError, match="has no directions to Sun and observer, which spin needs"):
        lcbayes.spin(curve)
    lcbayes.write(curve, tmp_path / "again.csv")
    again = lcbayes.read(tmp_path / "again.csv", geometry=False)
    assert again.brightness.tolist() == curve.brightness.tolist()


def test_the_figures_in_python():
    result = lcbayes.look(steady(3, 50.0, spinning=True))
    for draw in ("light_curve", "phase_angle", "periodogram", "folded"):
        assert getattr(result, f"plot_{draw}")().axes
    table = result.summary()
    assert set(table.columns) == {"command", "answers", "suits", "why", "cost_s"}
    known = table[table.command.str.contains("--model body")]
    assert known.suits.tolist() == [True]
    assert known.cost_s.tolist() == [BODY_S + BODY_EPOCH_S * result.curve.n_obs]


def test_a_peak_of_which_no_pass_holds_six_cycles_is_not_folded(tmp_path, monkeypatch):
    """As for a slow body: noise would not give the peak, but there is no period."""
    result = lcbayes.look(steady(3, 50.0, spinning=True))
    assert result.data is not None
    assert result.data.significant
    slow = replace(result.data, listed=[])
    advised = [one.command for one in advise(result.curve, dict(result.content), slow)]
    assert not any("--spin none" in command for command in advised)  # it turns all the same
    monkeypatch.setattr(type(result), "data", slow)
    result.save(tmp_path / "look")
    page = result.write_report().read_text(encoding="utf-8")
    assert "Periodogram of a sinusoid" in page
    assert "folded with the best period" not in page
    with pytest.raises(InputError, match="no period was found to fold"):
        result.plot_folded()


def test_a_period_that_is_not_accurate_enough_for_an_asteroid_is_scanned_first():
    """Over years, a spin is told apart from one that differs by half a turn in all of them."""
    result = lcbayes.look(steady(3, 50.0, spinning=True))
    asteroid = replace(result.curve, frame="ecliptic-j2000", range_km=None)

    def commands(span):
        facts = dict(result.content) | {"orbit": False, "span_s": span}
        return [one.command for one in advise(asteroid, facts, result.data) if one.suits]

    scan, fit = [line for line in commands(1e8) if " scan" in line]
    assert scan.startswith("lcbayes scan")
    assert "--model convex-grid --start-from scan -o out" in fit
    assert not any("--model body" in line for line in commands(1e8))
    assert any("--model convex-grid --period 0.0" in line for line in commands(5.0))


@pytest.fixture
def six_nights(tmp_path):
    """An asteroid on six nights in years, none of which shows its period; the truth."""
    case = asteroids.draw_case("ellipsoid", 2)
    asteroids.write(case, tmp_path / "asteroid.lcs")
    return tmp_path / "asteroid.lcs", case


def test_an_asteroid_without_a_period_is_scanned_over_all_usual_ones(six_nights, tmp_path):
    path, _ = six_nights
    result = lcbayes.look(path)
    periods = result.content["periods"]
    assert periods is not None
    assert not periods["significant"]
    suited = [shlex.split(one["command"]) for one in result.content["commands"] if one["suits"]]
    scan, fit = suited
    assert scan[1:3] == ["scan", str(path)]
    assert scan[3:] == ["--period-range", "2,1000", "--first-stage", "periodogram", "-o", "scan"]
    assert fit[3:] == ["--model", "convex-grid", "--start-from", "scan", "-o", "out"]
    result.save(tmp_path / "look")
    page = result.write_report().read_text(encoding="utf-8")
    assert (
        "Curves of a distant object over months or years; after the scan, or with --period HOURS"
        in page
    )


def test_a_period_too_short_for_an_asteroid_does_not_hide_the_scan_of_all(six_nights):
    """A trend within nights may look like a rapid rotation."""
    asteroid = lcbayes.look(six_nights[0])
    rapid = lcbayes.look(steady(3, 50.0, spinning=True)).data
    advised = advise(asteroid.curve, dict(asteroid.content), rapid)
    every, near, fit = [one for one in advised if one.suits]
    assert "--period-range 2,1000 --first-stage periodogram" in every.command
    assert every.why.startswith("no usual period is detected")
    assert "far shorter than those usual for asteroids" in near.why
    assert "--start-from scan" in fit.command


@pytest.mark.parametrize(
    "change",
    [
        {"frame": "icrs"},  # which the first stage of that scan refuses
        {"t": np.linspace(0.0, 100 * 86400.0, 300)},
    ],
)
def test_another_curve_without_a_period_needs_a_range(six_nights, change):
    path, _ = six_nights
    result = lcbayes.look(path)
    facts = dict(result.content) | {"span_s": 1e8}
    curve = replace(result.curve, **change)
    listed = {one.command.split()[1]: one for one in advise(curve, facts, result.data)}
    assert "--period-range FROM,TO" in listed["scan"].command
    assert "# frame" not in listed["scan"].why
    assert not listed["scan"].suits
    assert "--period HOURS" in listed["fit"].command


def test_a_table_that_does_not_name_its_axes_is_told_how(six_nights, tmp_path):
    """Only axes of the ecliptic serve the search of all usual periods; a table may name them."""
    path, _ = six_nights
    curve = replace(lcbayes.read(path), frame="inertial")
    lcbayes.write(curve, tmp_path / "table.csv")
    (scan,) = [
        one
        for one in lcbayes.look(tmp_path / "table.csv").content["commands"]
        if one["command"].startswith("lcbayes scan")
    ]
    assert not scan["suits"]
    (line,) = re.findall(r"'(# frame: .*?)'", scan["why"])
    text = (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines()
    text = [line, *(row for row in text if not row.startswith("# frame"))]
    (tmp_path / "named.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
    named = lcbayes.look(tmp_path / "named.csv").content["commands"]
    assert any("--first-stage periodogram" in one["command"] for one in named if one["suits"])


@pytest.mark.slow
def test_that_scan_finds_the_period(six_nights):
    path, case = six_nights
    result = lcbayes.scan(path, period_range=(2.0, 1000.0), first_stage="periodogram", n_sky=0)
    best = result.content["solutions"][0]
    assert best.get("period_h") == pytest.approx(case.period_h, rel=1e-4)


def test_periods_that_explain_nearly_as_much_are_named_with_the_scan():
    result = lcbayes.look(steady(3, 50.0, spinning=True))
    asteroid = replace(result.curve, frame="ecliptic-j2000", range_km=None)
    candidates = result.data
    assert candidates is not None
    first = replace(candidates.listed[0], explained=0.8)
    facts = dict(result.content) | {"orbit": False, "span_s": 1e8}

    def reason(explained, joined=True):
        other = replace(first, period_s=18_000.0, explained=explained)
        found = replace(candidates, joined=joined, listed=[first, other])
        return next(one.why for one in advise(asteroid, facts, found) if " scan" in one.command)

    assert reason(0.75) == "a period is detected; 5 h explains nearly as much: scan there too"
    assert reason(0.5) == reason(0.75, joined=False) == "a period is detected"


def test_it_starts_without_jax(bare):
    code = (
        "import sys; from lcbayes.cli import main; main.main(sys.argv[1:]); "
        "print([n for n in ('jax', 'numpyro', 'arviz', 'matplotlib.pyplot') if n in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "look", str(bare)], check=True, capture_output=True, text=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
