"""Catalogues of sparse points: objects an hour, cost, memory, and the page of many rows.

    python benchmarks/catalogues.py throughput [N]   simulated objects, with and without refinement
    python benchmarks/catalogues.py real             the inputs of Asteroids@home as one table
    python benchmarks/catalogues.py cost             against points and range of periods
    python benchmarks/catalogues.py memory [N]       N small objects with the search left out
    python benchmarks/catalogues.py page [N]         the page of N rows, in a browser

Needs the Asteroids@home inputs, as `surveys.py`. Each writes a section of RESULTS.md, with the load
of the machine while it ran.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from _results import table, write_section
from _surveys import KINDS, Cadence, draw, folder
from surveys import SEED, UNIQUE, cadences, curve, load

import lcbayes
from lcbayes.analysis import survey_page
from lcbayes.core import cluster
from lcbayes.core.constants import DAY_S
from lcbayes.core.progress import Console
from lcbayes.inversion.attitude_scan import sparse
from lcbayes.inversion.attitude_scan import survey as method
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.results import survey_table
from lcbayes.results.reasons import reasons
from lcbayes.tasks.survey.result import Survey

TEN_YEARS_S = 3652.0 * DAY_S
SMALL = 12  # points of an object of which only the reading is measured
GROUP = 1000  # objects that are written at once


def columns(data: Cadence) -> dict[str, list[float]]:
    result: dict[str, Any] = {"jd": data.jd, "flux": data.flux}
    for name, vectors in (("sun", data.sun), ("obs", data.earth)):
        result |= {f"{name}_{axis}": vectors[:, i] for i, axis in enumerate("xyz")}
    return {name: values.tolist() for name, values in result.items()}


def write_nested(objects: Any, path: Path) -> None:
    """Parquet with one row an object, written in groups."""
    writer, rows = None, []

    def flush() -> None:
        nonlocal writer
        part = pa.Table.from_pylist(rows)
        writer = writer or pq.ParquetWriter(path, part.schema)
        writer.write_table(part)
        rows.clear()

    for name, points in objects:
        rows.append({"object": name, "frame": "ecliptic-j2000", "calibrated": 0, **points})
        if len(rows) == GROUP:
            flush()
    if rows:
        flush()
    assert writer is not None
    writer.close()


def throughput(number: int) -> None:
    """The survey of simulated objects on as many processes as this one has cores, without
    refinement and with it."""
    every = [c for c in cadences() if c.curve.max() == 0]
    cases = (draw(every[i % len(every)], KINDS[i % len(KINDS)], SEED + i) for i in range(number))
    cores = len(os.sched_getaffinity(0))
    measured = []
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "survey.parquet"
        write_nested(((f"S{i}", columns(case.data)) for i, case in enumerate(cases)), path)
        for refine in (False, True):
            out = Path(scratch) / f"out-{refine}"
            given = {"workers": cores, "refine": refine, "progress": Console()}
            begun = time.monotonic()
            result = lcbayes.survey(path, out=out, **given)
            wall = time.monotonic() - begun
            c, seconds = result.content, result.summary().drop_duplicates("object")["seconds"]
            measured.append(
                [
                    "with refinement" if refine else "first stage",
                    f"{c['n_failed']} of {number}",
                    f"{3600 * number / wall:.0f}",
                    f"{seconds.min():.1f}",
                    f"{seconds.median():.1f}",
                    f"{seconds.max():.1f}",
                    load(),
                ]
            )
    heads = ["stage", "failed", "objects an hour", "time of an object, least (s)"]
    heads += ["median (s)", "longest (s)", "load at the end"]
    text = (
        f"Simulated objects of about 100 points, 2 to 1000 h, on {cores} of the cores. Times are "
        "those on the clock: objects an hour with the start of processes and compilation, which "
        "weigh heavily in a short run, and the longest time of an object is one that compiled. "
        "With refinement a convex body is fitted to each of at most 12 solutions.\n\n"
    )
    write_section(
        "Surveys: objects per hour",
        f"python benchmarks/catalogues.py throughput {number}",
        text + table(heads, measured),
    )


def real() -> None:
    """The survey of the real objects, on two processes."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        result = lcbayes.survey(folder(), out=out, workers=2, progress=Console())
        rows, c = result.summary(), result.content
        kb = {
            name: (out / path).stat().st_size / 1000
            for name, path in (
                ("journal", "objects.jsonl"),
                ("parquet", "tables/solutions.parquet"),
                ("csv", "tables/solutions.csv"),
                ("page", "report.html"),
            )
        }
    first = rows.drop_duplicates("object")
    measured = [
        ["objects", str(c["n_objects"])],
        ["failed", str(c["n_failed"])],
        ["rows of the table", str(len(rows))],
        [f"periods with P ≥ {UNIQUE}", str(np.sum(first["period_probability"] >= UNIQUE))],
        ["trusted", str(c["n_trusted"])],
        ["objects per hour", f"{c['objects_per_hour']:.0f}"],
        ["time of an object, median (s)", f"{first['seconds'].median():.1f}"],
        ["journal (kB)", f"{kb['journal']:.0f}"],
        ["table, Parquet and CSV (kB)", f"{kb['parquet']:.0f}, {kb['csv']:.0f}"],
        ["page (kB)", f"{kb['page']:.0f}"],
        ["load at the end", load()],
    ]
    text = (
        "The inputs of Asteroids@home, 2 to 1000 h, two processes. Times are those on the clock, "
        "with compilation, and say little if other work ran beside.\n\n"
    )
    write_section(
        "Surveys: real objects as one table",
        "python benchmarks/catalogues.py real",
        text + table(["what", "measured"], measured),
    )


def cost() -> None:
    """Processor time of objects of several sizes and ranges, after compilation."""
    every = [curve(c) for c in cadences() if c.curve.max() == 0]
    longest = max(every, key=lambda c: c.n_obs)
    rows = []
    half = longest.select(np.arange(longest.n_obs) % 2 == 0)
    for light, low, high in (
        (half, 2.0, 1000.0),
        (longest, 2.0, 1000.0),
        (_repeated(longest, 2), 2.0, 1000.0),
        (_repeated(longest, 4), 2.0, 1000.0),
        (longest, 4.0, 1000.0),
        (longest, 8.0, 1000.0),
        (longest, 2.0, 30.0),
        (longest, 2.0, 10_000.0),
        (replace(longest, t=longest.t * TEN_YEARS_S / np.ptp(longest.t)), 2.0, 1000.0),
    ):
        rows.append(_cost(light, (low, high)))
    heads = ["points", "days", "periods (h)", "frequencies", "CPU (s)", "periodogram alone (s)"]
    text = (
        "Processor time of one process, without compilation. More points are the same epochs "
        "again, half an hour later; ten years are the same epochs further apart. "
        f"Load at the end: {load()}.\n\n"
    )
    text += table(heads, rows)
    write_section("Surveys: cost of an object", "python benchmarks/catalogues.py cost", text)


def _repeated(light: Any, times: int) -> Any:
    if times == 1:
        return light
    t = np.concatenate([light.t + 1800.0 * k for k in range(times)])
    at = np.argsort(t, kind="stable")
    rows = np.tile(np.arange(light.n_obs), times)[at]
    return lcbayes.LightCurve(
        t=t[at],
        brightness=light.brightness[rows],
        error=None,
        sun=light.sun[rows],
        obs=light.obs[rows],
        kind="flux",
        free_scale=np.ones(1, bool),
        frame="ecliptic-j2000",
    )


def _cost(light: Any, range_h: tuple[float, float]) -> list[str]:
    from lcbayes.inversion.attitude_scan import periodogram

    points, parts = SparsePoints.of(light), []
    original = periodogram.periodogram

    def timed(*given: Any) -> Any:
        begun = time.process_time()
        value = original(*given)
        parts.append(time.process_time() - begun)
        return value

    sparse.periodogram = timed  # type: ignore[assignment]
    low, high = range_h
    sparse.search(points, (0.99 * high, high))  # compiles
    begun = time.process_time()
    result = sparse.search(points, range_h)
    took = time.process_time() - begun
    sparse.periodogram = original
    cells = [f"{low:g} to {high:g}", str(len(result.frequencies)), f"{took:.1f}"]
    return [str(light.n_obs), f"{np.ptp(light.t) / DAY_S:.0f}", *cells, f"{parts[-1]:.1f}"]


def fixed_rows(light: Any, _: Any) -> Any:
    """In place of the search: rows whose numbers come from the points."""
    first = float(light.brightness[0])
    row = {
        "period_resolution_h": 1e-3,
        "frame": light.frame,
        "rms": 0.05,
        "n_obs": light.n_obs,
        "n_curves": 1,
        "span_days": 900.0,
    }
    rows = [
        row
        | {
            "period_h": float(np.exp(2.0 + 3.0 * (first + 0.3 * k) % 4.0)),
            "amplitude_mag": float(0.1 + (7.0 * first) % 0.9),
            "pole_lon_deg": float((1e4 * first + 90 * k) % 360.0),
            "pole_lat_deg": float(np.degrees(np.arcsin((3e3 * first) % 2.0 - 1.0))),
            "period_probability": float((1e3 * first) % 1.0),
            "probability": float(0.5 * ((1e3 * first) % 1.0)),
        }
        for k in range(3)
    ]
    return rows, []


def small_objects(number: int) -> Any:
    rng = np.random.default_rng(1)
    for i in range(number):
        jd = 2458000.0 + np.sort(rng.uniform(0.0, 2000.0, SMALL))
        vectors = rng.normal(size=(6, SMALL))
        names = [f"{name}_{axis}" for name in ("sun", "obs") for axis in "xyz"]
        points = {"jd": jd.tolist(), "flux": rng.uniform(0.5, 1.5, SMALL).tolist()}
        points |= {name: v.tolist() for name, v in zip(names, vectors, strict=True)}
        yield f"S{i}", points


def read_and_write(path: str, out: str) -> None:
    """A survey without its search, in the threads of this process; prints its peak memory."""
    method.rows_of = fixed_rows
    cluster.find_spec = lambda _: None  # type: ignore[assignment]
    begun, cpu = time.monotonic(), time.process_time()
    result = lcbayes.survey(path, out=out)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    took = time.monotonic() - begun, time.process_time() - cpu
    print(result.content["n_objects"], result.content["n_failed"], f"{peak:.0f}", *took)


def memory(number: int) -> None:
    rows = []
    for n in (number // 10, number):
        with tempfile.TemporaryDirectory() as scratch:
            path, out = Path(scratch) / "survey.parquet", Path(scratch) / "out"
            write_nested(small_objects(n), path)
            command = [sys.executable, __file__, "read", str(path), str(out)]
            said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            objects, failed, peak, wall, cpu = said.split()[-5:]
            again = time.monotonic()
            subprocess.run(command, check=True, capture_output=True)
            again = time.monotonic() - again
            sizes = [
                (out / name).stat().st_size / 2**20
                for name in ("objects.jsonl", "tables/solutions.parquet", "report.html")
            ]
            if keep := os.environ.get("KEEP"):
                import shutil

                shutil.copytree(out, keep, dirs_exist_ok=True)
        rows.append(
            [objects, failed, peak, f"{float(wall):.0f}", f"{float(cpu):.0f}"]
            + [f"{size:.1f}" for size in sizes]
            + [f"{again:.0f}"]
        )
    heads = ["objects", "failed", "peak memory (MiB)", "wall (s)", "CPU (s)"]
    heads += ["journal (MiB)", "table (MiB)", "page (MiB)", "again (s)"]
    text = (
        f"Objects of {SMALL} points, one row an object, with the search replaced by three fixed "
        "solutions, since it would take days: everything else is done as in a survey (reading, "
        "checks, journal, table, page), by the threads of one process whose memory includes that "
        f"of JAX, NumPy and Matplotlib. Load at the end: {load()}.\n\n"
    )
    write_section(
        "Surveys: memory of many objects",
        f"python benchmarks/catalogues.py memory {number}",
        text + table(heads, rows),
    )


def synthetic_rows(number: int) -> Any:
    """Rows of many objects, one in fifty of which failed."""
    rng = np.random.default_rng(3)
    period = np.exp(rng.normal(np.log(8.0), 0.8, number))
    amplitude, z = rng.gamma(3.0, 0.1, number), rng.uniform(-1.0, 1.0, number)
    chance = rng.beta(0.4, 0.6, number)
    for i in range(number):
        if i % 50 == 7:
            text = f"survey.parquet, object S{i}, row 3: flux is negative"
            yield [
                dict.fromkeys(survey_table.COLUMNS)
                | {"object": f"S{i}", "status": "failed", "seconds": 0.1, "reasons": text}
            ]
            continue
        known = {"period_h": period[i], "period_resolution_h": 1e-5 * period[i] ** 2}
        known |= {"pole_lon_deg": float((7.1 * i) % 360), "amplitude_mag": amplitude[i]}
        known |= {"pole_lat_deg": float(np.degrees(np.arcsin(z[i]))), "seconds": 3.0}
        known |= {"period_probability": chance[i], "probability": 0.5 * chance[i], "rms": 0.1}
        about = {"object": f"S{i}", "status": "not trusted", "solution": 1, "n_obs": 100}
        yield [about | known | {"frame": "ecliptic-j2000", "reasons": "the period is not unique"}]


def page(number: int) -> None:
    import shutil

    from playwright.sync_api import sync_playwright

    held = survey_table.SurveyTable(lambda: synthetic_rows(number))
    content, against = survey_table.summarise("survey.parquet", held, number, 0, 3e5, "synthetic")
    made = Survey(content, reasons(against), {}, held)
    with tempfile.TemporaryDirectory() as scratch:
        folder, begun = Path(scratch), time.monotonic()
        survey_page.write_page(
            folder,
            held,
            made.content,
            {"options": {}, "catalogue": "survey.parquet", "version": ""},
        )
        wrote = time.monotonic() - begun
        size = (folder / "report.html").stat().st_size / 2**20
        if keep := os.environ.get("KEEP"):
            shutil.copy(folder / "report.html", keep)
        times = []
        with sync_playwright() as driver:
            browser = driver.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
            )
            for _ in range(5):
                view = browser.new_page(viewport={"width": 1280, "height": 900})
                view.goto(f"file://{folder}/report.html")
                entry = "performance.getEntriesByType('navigation')[0].loadEventEnd"
                times.append(float(view.evaluate(entry)) / 1000)
                view.close()
            browser.close()
    rows = [
        ["objects", f"{number}"],
        ["file (MiB)", f"{size:.2f}"],
        ["written in (s)", f"{wrote:.1f}"],
        ["loaded in headless Chromium, median of five (s)", f"{np.median(times):.2f}"],
        ["loaded, longest (s)", f"{max(times):.2f}"],
    ]
    text = f"Synthetic rows, one in fifty failed. Load at the end: {load()}.\n\n"
    write_section(
        "Surveys: the page of many rows",
        f"python benchmarks/catalogues.py page {number}",
        text + table(["what", "measured"], rows),
    )


if __name__ == "__main__":
    what, *given = sys.argv[1:]
    if what == "read":
        read_and_write(*given)
    elif what == "cost":
        cost()
    elif what == "real":
        real()
    else:
        run, default = {
            "throughput": (throughput, 60),
            "memory": (memory, 100_000),
            "page": (page, 100_000),
        }[what]
        run(int(given[0]) if given else default)
