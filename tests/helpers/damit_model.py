"""An independent reader of the files of a DAMIT model, and the brightness of its triangles.

Plain NumPy, without any code of the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass
class Model:
    """Corners of the triangles (F, 3, 3) in the body frame, and the numbers of ``spin.txt``."""

    corners: np.ndarray
    lon: float
    lat: float
    period_h: float
    jd0: float
    phi0: float
    a: float = 0.0
    d: float = 1.0
    k: float = 0.0
    c: float = 0.1

    def flux(self, jd: np.ndarray, sun: np.ndarray, earth: np.ndarray) -> np.ndarray:
        """S(phase) Σ A [μ₀μ/(μ₀+μ) + c μ₀μ] at each date (T,), ecliptic unit vectors (T, 3)."""
        edge1, edge2 = (self.corners[:, i] - self.corners[:, 0] for i in (1, 2))
        vectors = 0.5 * np.cross(edge1, edge2)  # area times outward normal
        areas = np.linalg.norm(vectors, axis=1)
        keep = areas > 1e-14
        normals, areas = vectors[keep] / areas[keep, None], areas[keep]
        out = np.empty(len(jd))
        for i, (t, s, e) in enumerate(zip(jd, sun, earth, strict=True)):
            turned = normals @ self.to_ecliptic(t).T
            mu0, mu = np.maximum(turned @ s, 0.0), np.maximum(turned @ e, 0.0)
            both = (mu0 > 0) & (mu > 0)
            mu0, mu = mu0[both], mu[both]
            kernel = mu0 * mu / (mu0 + mu) + self.c * mu0 * mu
            phase = np.arccos(np.clip(s @ e, -1.0, 1.0))
            law = self.a * np.exp(-phase / self.d) + self.k * phase + 1.0
            out[i] = law * (areas[both] @ kernel)
        return out

    def to_ecliptic(self, jd: float) -> np.ndarray:
        """R_z(λ) R_y(90° − β) R_z(φ₀ + 2π (t − t₀)/P), (3, 3)."""
        turns = np.mod((jd - self.jd0) * 24.0 / self.period_h, 1.0)
        return (
            about_z(np.radians(self.lon))
            @ about_y(np.radians(90.0 - self.lat))
            @ about_z(np.radians(self.phi0) + 2.0 * np.pi * turns)
        )


def about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def about_y(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def read(folder: Path, tail: str = "") -> Model:
    """``shape.txt`` and ``spin.txt`` of a folder."""
    words = [line.split() for line in (folder / f"shape{tail}.txt").read_text().splitlines()]
    count, faces = map(int, words[0])
    assert len(words) == 1 + count + faces
    vertices = np.array(words[1 : 1 + count], float)
    numbers = np.array(words[1 + count :], int)
    assert numbers.min() == 1
    assert numbers.max() == count
    rows = (folder / f"spin{tail}.txt").read_text().splitlines()
    spin, epoch, phase, lambert = ([float(x) for x in row.split()] for row in rows)
    return Model(vertices[numbers - 1], *spin, *epoch, *phase, *lambert)


def read_obj(path: Path) -> np.ndarray:
    """The triangles of an OBJ file, larger faces as fans, (F, 3, 3)."""
    vertices, fans = [], []
    for line in path.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(x) for x in rest])
        if word == "f":
            i = [int(x) - 1 for x in rest]
            fans += [[i[0], i[k], i[k + 1]] for k in range(1, len(i) - 1)]
    return np.array(vertices)[np.array(fans)]


def read_stl(path: Path) -> tuple[str, np.ndarray]:
    """The header and the triangles (F, 3, 3) of a binary STL file."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    assert len(data) == 84 + 50 * count
    rows = [np.frombuffer(data[84 + 50 * i :][:48], "<f4").reshape(4, 3) for i in range(count)]
    return data[:80].rstrip(b"\0").decode(), np.array(rows)[:, 1:].astype(float)
