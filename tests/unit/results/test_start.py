"""The folder of a scan or a spin, read again as the start of a fit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import lcbayes
from lcbayes.cli import main
from lcbayes.core.errors import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_INTERRUPTED,
    EXIT_NOT_TRUSTED,
    InputError,
)
from lcbayes.core.progress import Silent
from lcbayes.modelling import registry
from lcbayes.modelling.known_spin import Period
from lcbayes.modelling.variables import SPIN
from lcbayes.results.reasons import reason as sentence
from lcbayes.results.start import Start, candidate_periods, read_start
from lcbayes.tasks.fit import run
from lcbayes.tasks.fit.assumptions import assumptions
from lcbayes.tasks.fit.options import FitOptions
from tests.helpers import small_curves

FITTING = ["--n-facets", "1", "--num-starts", "16", "--num-warmup", "10", "--num-samples", "10"]
SOLUTION = dict.fromkeys(SPIN, 1.0) | {"near_equal": True}
HEAD = 'schema = 4\ntask = "scan"\n'
INPUT = HEAD + '[input.curve]\npath = "a.csv"\nsha256 = "0"\n'


@pytest.mark.parametrize(
    ("summary", "toml", "says"),
    [
        ([1, 2], INPUT, "is no JSON object"),
        ({}, INPUT.replace("scan", "fit"), "holds no scan"),
        ({"model": "attitude-scan"}, INPUT, "found no constant spin"),
        ({"model": "attitude-scan", "solutions": [3, {}]}, INPUT, "found no constant spin"),
        ({"model": "attitude-scan"}, HEAD + "input = 3\n", "input is 3; expected a table"),
        ({"model": "attitude-scan"}, INPUT.replace('"0"', '"1"'), "is of another light curve"),
    ],
)
def test_a_damaged_scan_is_named_in_a_line(tmp_path, summary, toml, says):
    curve = replace(small_curves.curve(20), source={"sha256": "0"})
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    (tmp_path / "run.toml").write_text(toml)
    with pytest.raises(InputError, match=says):
        read_start(tmp_path, curve)
    whole = {"model": "attitude-scan", "solutions": [SOLUTION]}
    (tmp_path / "summary.json").write_text(json.dumps(whole))
    (tmp_path / "run.toml").write_text(INPUT)
    assert read_start(tmp_path, curve) == Start([SOLUTION])


@pytest.mark.parametrize("spin", ["flat", "free"])
def test_a_scan_gives_a_known_body_its_periods(spin):
    """Its search visits all poles and rates at these periods, instead of moving given starts."""
    hours = [20.0 / 3600.0, 20.1 / 3600.0, 40.0 / 3600.0]
    start = Start([SOLUTION | {"period_h": period} for period in hours])
    spins, asked = run._started(start, registry.find("body"), {"spin": spin})
    assert spins == []
    found = [Period.of(text) for text in asked["period"].split(",")]
    assert [(p.low, p.high) for p in found] == [
        pytest.approx((20.0 * np.exp(-0.01), 20.1 * np.exp(0.01))),
        pytest.approx((40.0 * np.exp(-0.01), 40.0 * np.exp(0.01))),
    ]
    facets = run._started(start, registry.find("faceted"), {})
    assert facets == (start.spins, {})


def reason(code: str) -> dict[str, str]:
    return {"code": code, "text": f"about {code}"}


@pytest.mark.parametrize(
    ("probability", "codes", "doubt"),
    [
        (0.6, ["period-not-unique"], "about period-not-unique"),
        (0.995, ["pole-not-unique"], ""),
        (0.995, ["pole-not-unique", "curve-contradicts"], "about curve-contradicts"),
        (None, ["period-not-unique"], ""),  # the fit follows all spins that fit as well
    ],
)
def test_the_doubt_about_the_period_of_a_scan(tmp_path, monkeypatch, probability, codes, doubt):
    """It is a reason against the fit, unless the user gives a period."""
    lcbayes.write(small_curves.curve(20), tmp_path / "a.csv")
    curve = lcbayes.read(tmp_path / "a.csv")
    content = {"solutions": [SOLUTION], "period_probability": probability}
    content |= {"reasons": [reason(code) for code in codes]}
    (tmp_path / "summary.json").write_text(json.dumps(content))
    (tmp_path / "run.toml").write_text(INPUT.replace('"0"', f'"{curve.source["sha256"]}"'))
    assert read_start(tmp_path, curve).doubt == doubt

    posterior = SimpleNamespace(reasons=[])
    monkeypatch.setattr(run.engine, "run", lambda *_: posterior)
    monkeypatch.setattr(run, "assembled", lambda posterior, *_: posterior.reasons)
    context = SimpleNamespace(checkpoint=lambda _: None, progress=Silent())
    for given, expected in (({}, doubt), ({"period": "300s"}, "")):
        posterior.reasons.clear()
        options = FitOptions.of({"n_facets": 1, "start_from": tmp_path, **given})
        result: Any = run._fitted(curve, options, context)  # type: ignore[arg-type]
        assert [f.values["why"] for f in result] == ([expected] if expected else [])
        assert all(sentence(f).text.startswith("the period is that of the scan") for f in result)


def spin_folder(folder: Path, sha256: str, **content: Any) -> Path:
    """The folder of a spin of the light curve of that digest."""
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps({"solutions": []} | content))
    text = INPUT.replace("scan", "spin").replace('"0"', f'"{sha256}"')
    (folder / "run.toml").write_text(text)
    return folder


def test_candidate_periods_are_those_of_the_solutions():
    """Wide ranges, joined where they overlap; at least one per cent, or five sd."""
    solutions = [
        {"period_s": 20.0, "period_sd_s": 0.001},
        {"period_s": 20.1, "period_sd_s": 0.001},
        {"period_s": 40.0, "period_sd_s": 0.8},
        {"period_s": None, "period_sd_s": 0.1},
    ]
    result = [Period.of(text) for text in candidate_periods({"solutions": solutions})]
    assert [(p.low, p.high) for p in result] == [
        pytest.approx((20.0 * np.exp(-0.01), 20.1 * np.exp(0.01))),
        pytest.approx((40.0 * np.exp(-0.1), 40.0 * np.exp(0.1))),
    ]
    assert candidate_periods({"solutions": [], "photometric_period_s": None}) == []


def test_a_spin_without_a_period_is_no_start(tmp_path):
    curve = replace(small_curves.curve(20), source={"sha256": "0"})
    folder = spin_folder(tmp_path / "spin", "0", photometric_period_s=None)
    with pytest.raises(InputError, match="found no period to start from"):
        read_start(folder, curve)


def command_and_spin(tmp_path: Path) -> tuple[list[str], Path]:
    """The command line of a fit, and the folder of a spin of its light curve."""
    lcbayes.write(small_curves.curve(20), tmp_path / "a.csv")
    digest = lcbayes.read(tmp_path / "a.csv").source["sha256"]
    folder = spin_folder(tmp_path / "spin", digest, photometric_period_s=300.0)
    return ["fit", str(tmp_path / "a.csv"), "-o", str(tmp_path / "out"), "--no-report"], folder


@pytest.mark.parametrize(
    ("given", "period", "assumed"),
    [
        ((), "297-303s,594-606s,1188-1212s", "297 to 303 s (ends uncertain by"),
        (("--period", "5min", "--pole", "120,-45,30"), "5min", "300 ± "),
    ],
)
def test_a_fit_begins_with_the_periods_of_a_spin(tmp_path, monkeypatch, given, period, assumed):
    """They are options of the model and an assumption; --period goes before them."""
    argv, folder = command_and_spin(tmp_path)
    asked = []

    def stopped(_curve, entry, options, *_):
        asked.append((entry, options))
        raise KeyboardInterrupt

    monkeypatch.setattr(run.engine, "run", stopped)
    assert main.main([*argv, *FITTING, "--start-from", str(folder), *given]) == EXIT_INTERRUPTED
    ((entry, options),) = asked
    assert options["period"] == period
    assert options.get("pole") == ("120,-45,30" if given else None)
    said = " ".join(assumptions(lcbayes.read(tmp_path / "a.csv"), entry, options))
    assert f"The sidereal period is {assumed}" in said
    assert "in either sense (--period)" in said


@pytest.mark.slow
def test_a_fit_takes_its_prior_from_a_spin(tmp_path):
    """The periods are options of the model and an assumption."""
    argv, folder = command_and_spin(tmp_path)
    argv += [*FITTING, "--start-from", str(folder)]
    assert main.main(argv) in (EXIT_DONE, EXIT_NOT_TRUSTED)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["model_options"]["period"] == "297-303s,594-606s,1188-1212s"
    with xr.open_datatree(tmp_path / "out" / "posterior.nc") as tree:
        said = " ".join(json.loads(tree.attrs["assumptions"]))
    assert "The sidereal period is 297 to 303 s (ends uncertain by" in said
    assert "in either sense (--period)" in said


@pytest.mark.slow
def test_the_period_of_the_user_goes_before_that_of_a_spin(tmp_path):
    argv, folder = command_and_spin(tmp_path)
    argv += [*FITTING, "--start-from", str(folder), "--period", "5min", "--pole", "120,-45,30"]
    assert main.main(argv) in (EXIT_DONE, EXIT_NOT_TRUSTED)
    record = (tmp_path / "out" / "run.toml").read_text()
    assert 'period = "5min"' in record
    assert "pole = [120.0, -45.0, 30.0]" in record
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["model_options"]["period"] == "5min"
    assert summary["model_options"]["pole"] == "120,-45,30"


def test_a_pole_in_other_axes_is_refused(tmp_path, capsys):
    curve = replace(small_curves.curve(20), frame="ecliptic-j2000")
    with pytest.raises(InputError, match="the directions of this file are ecliptic"):
        lcbayes.fit(curve, n_facets=1, pole=(120, -45, 30))
    lcbayes.write(small_curves.curve(20), tmp_path / "a.csv")
    argv = ["fit", str(tmp_path / "a.csv"), "-o", str(tmp_path / "out")]
    for given, says in (
        (["--period", "23.7"], "'23.7' needs a unit"),
        (["--pole", "120,-45"], "--pole is '120,-45'; expected 3 numbers in deg"),
        (["--period", "20s", "--model", "stabilised"], "has no option 'period'"),
        (["--period", "20s", "--spin", "none"], "does not turn"),
    ):
        assert main.main([*argv, *given]) == EXIT_BAD_INPUT
        assert says in capsys.readouterr().err
