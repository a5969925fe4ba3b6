"""Draw `docs/figures/which-command.svg`: which command suits which light curve.

    python docs/make_which_command.py

The picture is as wide as a telephone, so that its text is never smaller than that of the page, and
follows the colours that the reader's system asks for.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

OUT = Path(__file__).parent / "figures" / "which-command.svg"
WIDTH, MARGIN, LEFT = 380, 14, 130
LINE, PAD = 19, 11


@dataclass(frozen=True)
class Case:
    """A kind of light curve, and the commands for it in order, each with what it determines."""

    light_curve: tuple[str, ...]
    commands: tuple[tuple[str, str], ...]


CASES = (
    Case(
        ("repeats within", "each pass:", "a spinning", "satellite"),
        (
            ("spin", "pole and period, no shape"),
            ("scan", "poles, each with a body"),
            ("fit", "facets and spin"),
        ),
    ),
    Case(
        ("repeats over", "months:", "an asteroid"),
        (
            ("scan", "poles and periods, ranked"),
            ("fit --model convex-grid", "shape, pole and period"),
        ),
    ),
    Case(
        ("does not repeat,", "orbit known:", "stabilised"),
        (
            ("attitude-test", "which laws the data allow"),
            ("fit --model stabilised", "facets under a law"),
        ),
    ),
    Case(
        ("has flashes of", "a few seconds"),
        (("glints", "directions of the facets"),),
    ),
    Case(
        ("is of a body of", "known attitude"),
        (("albedo-area", "albedo-area per direction"),),
    ),
)
AFTER = (
    ("compare", "how many facets?"),
    ("predict", "how bright tomorrow?"),
    ("observability", "what to observe next?"),
)

STYLE = """\
svg { font: 14px system-ui, sans-serif; --paper: #ffffff; --ink: #1c1f24; --soft: #5b636e;
  --line: #b9c0c9; --box: #f5f7f9; --strong: #e8f1fa; --edge: #0b5cad; }
@media (prefers-color-scheme: dark) { svg { --paper: #131416; --ink: #e6e8eb; --soft: #a7aeb8;
  --line: #4a515b; --box: #1d2024; --strong: #12283d; --edge: #5aa9f0; } }
text { fill: var(--ink); } .soft { fill: var(--soft); } .name { font-weight: 600; }
.paper { fill: var(--paper); } .case { fill: var(--box); stroke: var(--line); }
.command { fill: var(--strong); stroke: var(--edge); }
path { fill: none; stroke: var(--soft); stroke-width: 1.4; }
"""


def box(kind: str, x: float, y: float, width: float, height: float) -> str:
    return f'<rect class="{kind}" x="{x}" y="{y}" width="{width}" height="{height}" rx="7"/>'


def text(x: float, y: float, words: str, kind: str = "", anchor: str = "start") -> str:
    return f'<text x="{x}" y="{y}" class="{kind}" text-anchor="{anchor}">{escape(words)}</text>'


def arrow(x: float, y: float, to: float) -> str:
    return f'<path d="M{x} {y}V{to} m-4 -5l4 5l4 -5"/>'


def row(case: Case, y: float) -> tuple[list[str], float]:
    """The drawing of a case whose top is at y, and its height."""
    step = 2 * LINE + PAD
    gap = 14
    commands = len(case.commands) * (step + gap) - gap
    height = max(commands, len(case.light_curve) * LINE + 2 * PAD)
    x, width = LEFT + MARGIN + 22, WIDTH - LEFT - 2 * MARGIN - 22
    parts = [box("case", MARGIN, y, LEFT, height)]
    first = y + (height - len(case.light_curve) * LINE) / 2 + LINE - 5
    for i, words in enumerate(case.light_curve):
        parts.append(text(MARGIN + LEFT / 2, first + i * LINE, words, anchor="middle"))
    top = y + (height - commands) / 2
    middle = top + step / 2
    parts.append(f'<path d="M{MARGIN + LEFT} {middle}H{x - 2} m-5 -4l5 4l-5 4"/>')
    for i, (name, what) in enumerate(case.commands):
        at = top + i * (step + gap)
        parts.append(box("command", x, at, width, step))
        parts.append(text(x + 10, at + LINE, name, "name"))
        parts.append(text(x + 10, at + 2 * LINE, what, "soft"))
        if i:
            parts.append(arrow(x + width / 2, at - gap, at - 1))
    return parts, height


def picture() -> str:
    """The picture as SVG."""
    parts = [box("command", 95, 10, 190, 32), text(190, 31, "lcbayes look CURVE", "name", "middle")]
    parts += [arrow(190, 42, 58), text(190, 78, "If the light curve …", "soft", "middle")]
    y = 92.0
    for case in CASES:
        drawn, height = row(case, y)
        parts += drawn
        y += height + 16
    parts.append(text(190, y + 10, "then", "soft", "middle"))
    y += 22
    for name, what in AFTER:
        parts += [box("command", MARGIN, y, WIDTH - 2 * MARGIN, 32)]
        parts += [text(MARGIN + 10, y + 21, name, "name"), text(166, y + 21, what, "soft")]
        y += 40
    y += 6
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y:g}" width="{WIDTH}" '
        f'height="{y:g}" role="img" aria-label="Which command first">\n<style>\n{STYLE}</style>\n'
    )
    return head + "\n".join([box("paper", 0, 0, WIDTH, y), *parts]) + "\n</svg>\n"


if __name__ == "__main__":
    OUT.write_text(picture(), encoding="utf-8")
