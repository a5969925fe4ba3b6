"""Catalogues of sparse points in the layouts in which people keep them, written without lcbayes."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lcbayes.data.lightcurve import LightCurve
from tests.helpers import sparse_surveys

EPOCH = 2455000.5


def points(n_objects: int, seed: int = 1) -> dict[str, dict[str, np.ndarray]]:
    """Columns of sparse points of ellipsoids, with vectors in au, by object."""
    result = {}
    for k in range(n_objects):
        curve = sparse_surveys.observed(seed=seed + k)
        result[f"A{k}"] = {"jd": EPOCH + curve.t / 86400.0, "flux": curve.brightness} | {
            f"{name}_{axis}": scale * getattr(curve, name)[:, i]
            for name, scale in (("sun", 2.6), ("obs", 1.9))
            for i, axis in enumerate("xyz")
        }
    return result


def write_csv(objects: Mapping[str, dict[str, np.ndarray]], path: Path, name: str = "object"):
    """One row a point; the axes are a comment."""
    heads = list(next(iter(objects.values())))
    with path.open("w", newline="") as file:
        file.write("# frame: ecliptic-j2000\n")
        writer = csv.writer(file)
        writer.writerow([name, *heads, "calibrated"])
        for key, columns in objects.items():
            for row in zip(*columns.values(), strict=True):
                writer.writerow([key, *map(repr, map(float, row)), 0])
    return path


def write_flat(objects: Mapping[str, dict[str, np.ndarray]], path: Path, name: str = "object"):
    """Parquet with one row a point; the axes are metadata."""
    heads = list(next(iter(objects.values())))
    sizes = [len(columns[heads[0]]) for columns in objects.values()]
    table = {name: np.repeat(list(objects), sizes)}
    table |= {h: np.concatenate([columns[h] for columns in objects.values()]) for h in heads}
    table["calibrated"] = np.zeros(sum(sizes), int)
    made = pa.table(table).replace_schema_metadata({"frame": "ecliptic-j2000"})
    pq.write_table(made, path)
    return path


def write_nested(objects: Mapping[str, dict[str, np.ndarray]], path: Path, kind: str = "lists"):
    """Parquet with one row an object: lists, a struct of lists, or a list of structs."""
    rows = []
    for key, columns in objects.items():
        lists = {name: values.tolist() for name, values in columns.items()}
        if kind == "lists":
            points = lists
        elif kind == "struct of lists":
            points = {"points": lists}
        else:
            points = {
                "points": [
                    dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)
                ]
            }
        rows.append(
            {"object": key, "frame": "ecliptic-j2000", "calibrated": 0, "H": 15.0, **points}
        )
    pq.write_table(pa.Table.from_pylist(rows), path)
    return path


def asteroids_at_home(curve: LightCurve) -> str:
    """An input of Asteroids@home with these points."""
    head = ["2 1000 0.8 10"] + ["0"] * 13
    jd = EPOCH + curve.t / 86400.0
    rows = [
        " ".join(map(repr, map(float, (day, f, *(2.6 * s), *(1.9 * o)))))
        for day, f, s, o in zip(jd, curve.brightness, curve.sun, curve.obs, strict=True)
    ]
    return "\n".join([*head, "1", f"{len(rows)} 0 0", *rows]) + "\n"
