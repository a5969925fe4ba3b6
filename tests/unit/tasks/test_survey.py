"""`lcbayes.survey` without its search: rows, failures, limits of time, and resumption."""

from __future__ import annotations

import csv
import json
from contextlib import contextmanager

import numpy as np
import pandas as pd
import pytest

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core import cluster
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_INTERRUPTED, EXIT_NOT_TRUSTED
from lcbayes.core.reasons import Finding
from lcbayes.core.time_limit import check_time
from lcbayes.inversion.attitude_scan import survey as method
from lcbayes.results import survey_table
from lcbayes.tasks.survey import worker
from lcbayes.tasks.survey.options import SurveyOptions
from tests.helpers.survey_catalogues import points, write_csv, write_flat, write_nested

CELLS = ("period_h", "pole_lon_deg", "probability", "n_obs", "status", "solution", "reasons")


def quick(curve, effort):
    """Two solutions whose numbers come from the points."""
    if not np.all(curve.brightness > 0):
        raise lcbayes.InputError("1 points have no positive brightness")
    if curve.brightness[0] == 5.0:
        raise ZeroDivisionError("a fault\nof the program")
    if curve.brightness[0] == 6.0:
        while True:
            check_time()
    mean = float(curve.brightness.mean())
    common = {
        "period_resolution_h": 1e-3,
        "frame": curve.frame,
        "amplitude_mag": 0.3,
        "rms": 0.05,
        "n_obs": curve.n_obs,
        "n_curves": 1,
        "span_days": 900.0,
    }
    rows = [
        common
        | {
            "period_h": 7.0 * mean + k,
            "pole_lon_deg": 10.0 * curve.brightness[3],
            "pole_lat_deg": -5.0,
            "period_probability": 0.995 - 0.5 * k,
            "probability": 0.9 - 0.8 * k,
        }
        for k in range(2)
    ]
    against = [] if mean > 1 else [Finding("period-not-unique", {"others": "7 h fits as well"})]
    return rows[: effort.keep], against


@pytest.fixture
def searched(monkeypatch):
    """The names of the objects that were searched; the search is `quick`, in threads."""
    names, original = [], worker.search_object
    monkeypatch.setattr(method, "rows_of", quick)
    monkeypatch.setattr(cluster, "find_spec", lambda _: None)

    def counted(shared, entry):
        names.append(entry.name)
        return original(shared, entry)

    monkeypatch.setattr(worker, "search_object", counted)
    return names


@pytest.fixture(scope="module")
def objects():
    return points(4)


def changed(objects, name, value):
    """The catalogue with another first brightness of one object."""
    flux = objects[name]["flux"].copy()
    flux[0] = value
    return objects | {name: objects[name] | {"flux": flux}}


def table(folder):
    with (folder / "tables" / "solutions.csv").open() as file:
        return [{k: row[k] for k in ("object", *CELLS)} for row in csv.DictReader(file)]


@pytest.mark.usefixtures("searched")
def test_layouts_give_the_same_rows(objects, tmp_path, capsys):
    found = []
    for write, name in ((write_csv, "a"), (write_flat, "b"), (write_nested, "c")):
        path, out = write(objects, tmp_path / name), tmp_path / f"out-{name}"
        assert main(["survey", str(path), "-o", str(out), "--no-report"]) == EXIT_NOT_TRUSTED
        found.append(table(out))
        frame = pd.read_parquet(out / "tables" / "solutions.parquet")
        assert list(frame.columns) == list(survey_table.COLUMNS)
        assert frame["period_h"].tolist() == [float(row["period_h"]) for row in found[-1]]
        assert frame["reasons"].tolist() == [row["reasons"] for row in found[-1]]
    assert found[0] == found[1] == found[2]
    assert [(row["object"], row["solution"]) for row in found[0]] == [
        (f"A{i}", str(k)) for i in range(4) for k in (1, 2)
    ]
    first = found[0][0]
    assert float(first["period_h"]) == pytest.approx(7.0 * objects["A0"]["flux"].mean())
    assert first["n_obs"] == "120"
    assert "4 objects" in capsys.readouterr().out


def test_a_failing_object_is_a_row_and_stops_nobody(searched, objects, tmp_path):
    bad = changed(changed(changed(objects, "A1", -1.0), "A2", 5.0), "A3", 6.0)
    out = tmp_path / "out"
    result = lcbayes.survey(write_flat(bad, tmp_path / "a"), out=out, time_limit=0.5)
    rows = table(out)
    assert [row["object"] for row in rows] == ["A0", "A0", "A1", "A2", "A3"]
    assert [row["status"] for row in rows][2:] == ["failed"] * 3
    assert [row["reasons"] for row in rows][2:] == [
        "1 points have no positive brightness",
        "ZeroDivisionError: a fault",
        "took longer than the limit of 0.5 s (--time-limit)",
    ]
    content = json.loads((out / "summary.json").read_text())
    assert (content["n_failed"], content["n_solutions"], content["n_unique"]) == (3, 2, 1)
    assert {"code": "objects-failed", "text": "3 of 4 objects failed: A1, A2, A3"} in content[
        "reasons"
    ]
    page = (out / "report.html").read_text()
    assert "3 of 4 objects, by reason" in page
    assert "ZeroDivisionError: a fault" in page
    assert lcbayes.load(out).summary().equals(result.summary())
    # an error of the input is final; what may have been chance is tried again
    searched.clear()
    lcbayes.survey(tmp_path / "a", out=out, time_limit=0.5, report=False)
    assert sorted(searched) == ["A2", "A3"]
    assert table(out) == rows


@contextmanager
def stopping(*_, **__):
    """Workers that do two objects, and then somebody stops the run."""

    def run(function, shared, tasks):
        for i, task in enumerate(tasks):
            if i == 2:
                raise KeyboardInterrupt
            yield i, function(shared, *task)

    yield run


def test_an_interrupted_survey_goes_on(searched, objects, tmp_path, monkeypatch):
    path, out = write_csv(objects, tmp_path / "a"), tmp_path / "out"
    command = ["survey", str(path), "-o", str(out), "--no-report"]
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "worker_pool", stopping)
        assert main(command) == EXIT_INTERRUPTED
    assert "2 of 4 objects were not done" in (out / "summary.json").read_text()
    assert len(table(out)) == 4
    # killed while it wrote the line of the second object
    journal = out / "objects.jsonl"
    journal.write_bytes(journal.read_bytes()[:-20])
    searched.clear()
    assert main(command) == EXIT_NOT_TRUSTED
    assert sorted(searched) == ["A1", "A2", "A3"]
    whole = tmp_path / "whole"
    assert main(["survey", str(path), "-o", str(whole), "--no-report"]) == EXIT_NOT_TRUSTED
    assert table(out) == table(whole)
    searched.clear()
    assert main(command) == EXIT_NOT_TRUSTED
    assert searched == []


def test_only_what_changed_is_searched_again(searched, objects, tmp_path):
    out = tmp_path / "out"
    before = lcbayes.survey(write_csv(objects, tmp_path / "a"), out=out, report=False).summary()
    searched.clear()
    turned = {"new": objects["A0"], **dict(reversed(changed(objects, "A2", 1.3).items()))}
    result = lcbayes.survey(write_csv(turned, tmp_path / "a"), out=out, report=False)
    assert sorted(searched) == ["A2", "new"]
    after = result.summary()
    assert list(dict.fromkeys(after["object"])) == ["new", "A3", "A2", "A1", "A0"]
    columns = ["period_h", "pole_lon_deg", "probability"]
    for name in ("A0", "A1", "A3"):
        one, other = (t.loc[t["object"] == name, columns] for t in (before, after))
        np.testing.assert_array_equal(one, other)
    searched.clear()
    lcbayes.survey(tmp_path / "a", out=out, keep=1, report=False)
    assert len(searched) == 5
    searched.clear()
    lcbayes.survey(tmp_path / "a", out=out, keep=1, time_limit=99.0, report=False)
    assert searched == []  # the limit changes no number


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"flux": "counts"}, "no column of brightness; expected flux or mag"),
        ({"sun_x": "heliocentric_x"}, "has no column sun_x; expected all of"),
        ({"jd": "epoch"}, "has no column of times"),
        ({"jd": "MJD"}, ""),
    ],
)
@pytest.mark.parametrize("write", [write_csv, write_flat, write_nested])
def test_a_table_that_lacks_columns_is_refused(
    write, change, message, searched, objects, tmp_path, capsys
):
    named = {
        k: {change.get(n, n): v - 2400000.5 * (n == "jd" and "MJD" in change.values())
            for n, v in columns.items()}
        for k, columns in objects.items()
    }  # fmt: skip
    out = tmp_path / "out"
    status = main(["survey", str(write(named, tmp_path / "a")), "-o", str(out), "--no-report"])
    if not message:
        assert status == EXIT_NOT_TRUSTED
        assert len(searched) == 4
        return
    assert status == EXIT_BAD_INPUT
    said = capsys.readouterr().err.splitlines()[-1]
    assert message in said
    assert searched == []
    assert not out.exists()


@pytest.mark.parametrize("write", [write_csv, write_flat, write_nested])
def test_what_the_columns_were_taken_for_is_said_once(write, searched, objects, tmp_path, capsys):
    given = {k: columns | {"dflux": 0.1 * columns["flux"]} for k, columns in objects.items()}
    path, out = str(write(given, tmp_path / "a")), str(tmp_path / "out")
    assert main(["survey", path, "-o", out, "--no-report"]) == EXIT_NOT_TRUSTED
    assert len(searched) == len(objects)
    assert capsys.readouterr().err.count("note: column 'dflux' was taken for flux_err") == 1


def test_magnitudes_under_flux_are_refused(searched, objects, tmp_path, capsys):
    bright = {
        k: columns | {"flux": 18.0 - 2.5 * np.log10(columns["flux"])}
        for k, columns in objects.items()
    }
    path = str(write_flat(bright, tmp_path / "a"))
    assert main(["survey", path, "-o", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert "as magnitudes do; name the column mag" in capsys.readouterr().err
    words = ["--columns", "mag=flux", "--no-report"]
    assert main(["survey", path, "-o", str(tmp_path / "out"), *words]) == EXIT_DONE
    assert len(searched) == 4


def test_keys_tell_apart_what_determines_the_numbers(objects, tmp_path):
    from lcbayes.data.catalogues.opened import catalogue

    first, second, *_ = catalogue(write_csv(objects, tmp_path / "a")).objects()
    plain = SurveyOptions()
    keys = [
        worker.key_of(first, plain),
        worker.key_of(second, plain),
        worker.key_of(first, SurveyOptions(period_range=(2.0, 100.0))),
        worker.key_of(first, SurveyOptions(refine=True)),
        worker.key_of(first, SurveyOptions(error=0.1)),
    ]
    assert len(set(keys)) == len(keys)
    for running in (
        SurveyOptions(workers=2),
        SurveyOptions(time_limit=5.0),
        SurveyOptions(full=("A0",)),
    ):
        assert worker.key_of(first, running) == keys[0]
