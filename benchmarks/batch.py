"""A batch of simulated objects on local Dask processes, with a damaged file and a killed worker.

python benchmarks/batch.py second        cost of further objects of the same array shapes
python benchmarks/batch.py workers       objects per hour with threads and with processes
python benchmarks/batch.py               300 objects on as many processes as cores
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes.core.cluster import worker_pool
from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Console
from lcbayes.data.lightcurve import LightCurve
from lcbayes.physics import brightness
from lcbayes.tasks.batch.objects import objects
from lcbayes.tasks.batch.worker import fit_object

N_OBS, N_FACETS, NOISE = 40, 1, 0.02
OPTIONS = {
    "n_facets": N_FACETS,
    "spin": "none",
    "seed": 1,
    "num_chains": 2,
    "num_warmup": 100,
    "num_samples": 500,
}
KILL_AFTER = 20  # objects
OBJECTS = f"{N_FACETS} facet, spin none, {N_OBS} points, two chains of 100 + 500 draws."


def simulated(seed: int) -> LightCurve:
    """A facet that does not rotate, seen for a minute from directions all over a hemisphere."""
    rng = np.random.default_rng(seed)
    v = np.array([0.4, 0.75, 0.55]) + 0.45 * rng.standard_normal((2, N_OBS, 3))
    sun, obs = v / np.linalg.norm(v, axis=-1, keepdims=True)
    normals = np.array([0.4, 0.75, 0.55]) + 0.25 * rng.standard_normal((N_FACETS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    areas = np.exp(1.0 + 0.5 * rng.standard_normal(N_FACETS))
    t = np.linspace(0.0, 60.0, N_OBS)
    sun_body, obs_body = jnp.asarray(sun), jnp.asarray(obs)
    flux = brightness.flux(sun_body, obs_body, jnp.asarray(normals), jnp.asarray(areas))
    flux = np.asarray(flux)
    error = np.full(N_OBS, NOISE * flux.mean())
    noisy = flux + error * rng.standard_normal(N_OBS)
    return LightCurve(t=t, brightness=noisy, error=error, kind="flux", sun=sun, obs=obs)


def second() -> None:
    """Seconds of the first and of later objects, with equal and with different numbers of
    points."""
    rows = []
    for name, points in (
        ("first", 40),
        ("second, as many points", 40),
        ("third", 40),
        ("fewer points", 30),
        ("again", 30),
    ):
        light = simulated(len(rows))
        light = light.select(np.arange(N_OBS) < points)
        begun, used = time.monotonic(), time.process_time()
        lcbayes.fit(light, **OPTIONS)
        maps = len(Path("/proc/self/maps").read_text().splitlines())
        rows.append(
            [
                name,
                f"{time.monotonic() - begun:.1f}",
                f"{time.process_time() - used:.1f}",
                str(maps),
            ]
        )
    text = table(["object", "wall time (s)", "processor time (s)", "memory maps"], rows)
    write_section("Batch: the second object of a shape", "python benchmarks/batch.py second", text)


class Killer(Console):
    """Progress that kills a worker after a number of objects."""

    def __init__(self) -> None:
        self.killed: int | None = None

    def watch(self, folder: Path) -> None:
        """Wait for `KILL_AFTER` objects, then kill one of this process's workers."""
        while len(list(folder.glob("objects/*/object.json"))) < KILL_AFTER:
            time.sleep(1.0)
        self.killed = workers_of(os.getpid())[0]
        os.kill(self.killed, signal.SIGKILL)


def workers_of(parent: int) -> list[int]:
    """Processes below this one that have loaded JAX: the workers."""
    result = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            above = int(fields[1])
            loaded = "jaxlib" in (entry / "maps").read_text()
        except (OSError, IndexError):
            continue
        if above == parent and loaded:
            result.append(int(entry.name))
    return result


def workers(n: int = 30) -> None:
    """Objects per hour, without the first objects of each worker, which compile."""
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        curves = Path(scratch) / "curves"
        curves.mkdir()
        for i in range(n):
            lcbayes.write(simulated(1000 + i), curves / f"object-{i:03d}.csv")
        for name, count in (("threads of one process", None), ("1 process", 1), ("2 processes", 2)):
            with worker_pool(n_workers=count, keep_going=True) as run:
                tasks = [(one,) for one in objects(curves, OPTIONS)]
                where = (Path(scratch) / str(count)).as_posix()
                warm = 2 * (count or 2)
                list(run(fit_object, (where, False), tasks[:warm]))
                begun = time.monotonic()
                done = list(run(fit_object, (where, False), tasks[warm:]))
                took = time.monotonic() - begun
            assert all(row["status"] != "failed" for _, row in done)
            rows.append([name, f"{took:.1f}", f"{3600 * len(done) / took:.0f}"])
    text = f"{OBJECTS} After the first, which compile.\n\n"
    text += table(["who", "time (s)", "objects per hour"], rows)
    write_section("Batch: threads or processes", "python benchmarks/batch.py workers", text)


def batch(n: int = 300) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        curves, out = Path(scratch) / "curves", Path(scratch) / "out"
        curves.mkdir()
        for i in range(n):
            lcbayes.write(simulated(1000 + i), curves / f"object-{i:03d}.csv")
        damaged = curves / f"object-{n // 2:03d}.csv"
        lines = damaged.read_text().splitlines()
        lines[12] = lines[12][: len(lines[12]) // 2]
        damaged.write_text("\n".join(lines) + "\n")
        killer = Killer()
        threading.Thread(target=killer.watch, args=(out,), daemon=True).start()
        begun = time.monotonic()
        result = lcbayes.batch(curves, out=out, progress=killer, **OPTIONS)
        first = time.monotonic() - begun
        page = out / "report.html"
        again = time.monotonic()
        lcbayes.batch(curves, out=out, **OPTIONS)
        again = time.monotonic() - again
        s = result.content
        reason = next(row["reasons"][0]["text"] for row in result.rows if row["status"] == "failed")
        rows = [
            ["objects", str(n)],
            ["results", str(s["n_trusted"] + s["n_not_trusted"])],
            ["of them trusted", str(s["n_trusted"])],
            ["failures", f"{s['n_failed']}: {reason.replace(str(curves) + '/', '')}"],
            ["workers killed", "1" if killer.killed else "0"],
            ["wall time (s)", f"{first:.0f}"],
            ["objects per hour", f"{s['objects_per_hour']:.0f}"],
            ["the same command again (s)", f"{again:.1f}"],
        ]
        print(page)
        keep = os.environ.get("KEEP")
        if keep:
            import shutil

            shutil.copytree(out, keep, dirs_exist_ok=True)
    text = f"{OBJECTS} By {s['workers']}.\n\n"
    text += table(["what", "measured"], rows)
    write_section("Batch: many objects on local processes", "python benchmarks/batch.py", text)


if __name__ == "__main__":
    {"second": second, "workers": workers}.get(" ".join(sys.argv[1:]), batch)()
