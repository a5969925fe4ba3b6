"""Code blocks of README and docs, and the files that they take for granted."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import lcbayes
from lcbayes.data.lightcurve import LightCurve
from tests.helpers import survey_catalogues

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "lcbayes" / "simulation" / "scenarios"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LANGUAGES = {"sh", "python", "toml", "text"}

_BLOCK = re.compile(
    r"(?m)^(?:<!-- (?:not run: (?P<why>[^>]+)|needs: (?P<needs>[^>]+)) -->\n)?"
    r"(?P<indent> *)```(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=indent)```$",
    re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block: what it is written in, why it is not run where it is not, and the files of
    real observations that it needs.

    A comment above a block says so. With ``<!-- needs: damit/43_Ariadne_rel.lcs as a.lcs -->`` that
    file of the folder of observations is ``a.lcs`` where the block is run.
    """

    page: str
    line: int
    language: str
    text: str
    why_not: str | None
    needs: tuple[str, ...] = ()

    @property
    def commands(self) -> list[list[str]]:
        """The words of each command of a shell block, comments left out."""
        joined = self.text.replace("\\\n", " ")
        return [words for line in joined.splitlines() if (words := shlex.split(line, True))]

    def observations(self, data: Path, folder: Path) -> None:
        """Copy what the block needs."""
        for needed in self.needs:
            file, _, name = needed.partition(" as ")
            to = folder / (name or Path(file).name)
            to.parent.mkdir(exist_ok=True)
            to.write_bytes((data / file).read_bytes())


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    name = str(page.relative_to(ROOT))
    result = []
    for match in _BLOCK.finditer(text):
        indent = match["indent"]
        inside = "".join(x.removeprefix(indent) for x in match["text"].splitlines(keepends=True))
        line = text.count("\n", 0, match.start()) + 1
        needs = tuple(match["needs"].split(", ")) if match["needs"] else ()
        result.append(Block(name, line, match["language"], inside, match["why"], needs))
    return result


def simulate(scenario: Path | str, to: Path, seed: int = 1) -> None:
    from lcbayes.cli import main

    assert main.main(["simulate", str(scenario), "-o", str(to), "--seed", str(seed)]) == 0


def damit(curve: LightCurve, to: Path) -> None:
    """A light curve as a DAMIT file: relative, each night by itself."""
    assert curve.epoch_jd is not None
    nights = np.cumsum(np.concatenate([[0], np.diff(curve.t) > 43200.0]))
    lines = [str(nights[-1] + 1)]
    for night in range(nights[-1] + 1):
        at = np.flatnonzero(nights == night)
        lines.append(f"{at.size} 0")
        for i in at:
            row = (*(2.5 * curve.sun[i]), *(2.0 * curve.obs[i]))
            jd = curve.epoch_jd + curve.t[i] / 86400.0
            lines.append(f"{jd:.7f} {curve.brightness[i]:.6e} " + " ".join(f"{x:.8f}" for x in row))
    to.write_text("\n".join(lines) + "\n", encoding="utf-8")


def provide(folder: Path, words: list[str]) -> None:
    """The files that a command names and a user would have, made unless they are there."""
    tle = any(word.endswith(".tle") for word in words)
    makers = {
        r"(pass|passes|mine|tumbler|geo)\.csv": lambda p: with_elements(p) if tle else turning(p),
        r"(object|objects|geo|sat)\.tle": lambda p: copy("box-wing.tle", p),
        r"(starlink|pomenis_observations)\.csv": many_nights,
        r"tomorrow\.csv": lambda p: ranged(p) if (folder / "object.tle").exists() else turning(p),
        r"43_Ariadne\.lcs": asteroid,
        r"mine\.toml": scenario,
        r"tonight\.toml": three_facets,
        r"tonight\.csv": times,
        r"stage\.toml": known_body,
        r"\./mine\.py": own_model,
        r"model\.obj": box,
        r"night\.csv": catalogue,
        r"survey\.csv": lambda p: survey_catalogues.write_csv(survey_catalogues.points(1), p),
        r"out/posterior\.nc": lambda p: small_fit(p.parent),
        r"curves/": lambda p: (p.mkdir(exist_ok=True), with_elements(p / "1007.csv")),
    }
    for word in words:
        for pattern, make in makers.items():
            if re.fullmatch(pattern, word):
                make(folder / word)
    if "--posterior" in words:
        earlier_fit(folder / "tonight.toml", folder / words[words.index("--posterior") + 1])


def copy(name: str, to: Path) -> None:
    to.write_bytes((SCENARIOS / name).read_bytes())


def with_elements(to: Path) -> None:
    """Times, sites and flux: directions follow from the elements."""
    copy("box-wing.csv", to)


def times(to: Path) -> None:
    """Times alone, at which the object is above the horizon of other sites, too."""
    rows = (SCENARIOS / "box-wing.csv").read_text("utf-8").splitlines()[:20]
    to.write_text("".join(f"{row.partition(',')[0]}\n" for row in rows), encoding="utf-8")


def ranged(to: Path) -> None:
    """Directions and ranges are in the file."""
    simulate("box-wing", to)


def turning(to: Path) -> None:
    """Directions are in the file."""
    simulate("two-facet-spin", to)


def many_nights(to: Path) -> None:
    simulate(ROOT / "docs" / "gallery" / "stabilised.toml", to)


def scenario(to: Path) -> None:
    copy("box-wing.toml", to)
    copy("box-wing.tle", to.with_name("box-wing.tle"))


def three_facets(to: Path) -> None:
    """The bundled orbit and sites, with three facets listed."""
    text = (SCENARIOS / "box-wing.toml").read_text("utf-8")
    body, rest = text[text.index("[body]") : text.index("[materials.bus]")], "[materials.bus]"
    sides = ("[1, 0, 0]", "[0, 0.8, 0.6]", "[-0.5, 0, 1]")
    facets = "".join(
        f'[[body.facets]]\nnormal = {side}\narea_m2 = 2.0\nmaterial = "bus"\n' for side in sides
    )
    to.write_text(text.replace(body + rest, facets + rest), encoding="utf-8")
    copy("box-wing.tle", to.with_name("box-wing.tle"))


def earlier_fit(scenario: Path, out: Path) -> None:
    curve = scenario.with_name("earlier.csv")
    simulate(scenario, curve)
    short: dict[str, Any] = {
        "num_warmup": 50,
        "num_samples": 50,
        "num_chains": 2,
        "num_starts": 8,
        "max_modes": 1,
    }
    lcbayes.fit(lcbayes.read(curve), n_facets=3, out=out, seed=1, **short)


def small_fit(out: Path) -> None:
    """One facet, with few draws."""
    curve = out.with_name("one.csv")
    simulate("one-facet", curve)
    short: dict[str, Any] = {
        "num_warmup": 200,
        "num_samples": 200,
        "num_chains": 2,
        "num_starts": 8,
    }
    lcbayes.fit(
        lcbayes.read(curve), n_facets=1, spin="none", out=out, seed=1, report=False, **short
    )


def own_model(to: Path) -> None:
    (block,) = [b for b in blocks(ROOT / "docs" / "models.md") if b.language == "python"]
    to.write_text(block.text, encoding="utf-8")


def known_body(to: Path) -> None:
    (block,) = [b for b in blocks(ROOT / "docs" / "case-ariane.md") if b.language == "toml"]
    to.write_text(block.text, encoding="utf-8")


def box(to: Path) -> None:
    """A brick of 1 m by 2 m by 3 m as a Wavefront file."""
    corners = [(x, 2 * y, 3 * z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    lines = [*("v {} {} {}".format(*c) for c in corners), *(f"f {face}" for face in faces)]
    to.write_text("\n".join(lines) + "\n", encoding="utf-8")


def catalogue(to: Path) -> None:
    turning(to.with_name("one.csv"))
    turning(to.with_name("two.csv"))
    to.write_text("name,curve\none,one.csv\ntwo,two.csv\n", encoding="utf-8")


def asteroid(to: Path) -> None:
    plain = to.with_suffix(".csv")
    simulate("brick", plain)
    plain.write_text("# epoch_jd: 2460000.5\n" + plain.read_text("utf-8"), encoding="utf-8")
    damit(lcbayes.read(plain), to)
