"""The estimate for five million objects follows from the sections of RESULTS.md."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
TEXT = """# Results

## Surveys: calibration
Seeds 1 to 9. Processor time of an object: 7.2 s (median).

## Other: memory
| 5 | 0 | 7 |

## Surveys: memory of many objects
| objects | failed | peak memory (MiB) | wall (s) |
| --- | --- | --- | --- |
| 1000 | 0 | 400 | 137 |
| 11000 | 0 | 410 | 2243 |

## Surveys: real objects as one table
| what | measured |
| --- | --- |
| objects | 20 |
| journal (kB) | 30 |
| table, Parquet and CSV (kB) | 8, 89 |

## Surveys: one GPU beside a CPU
| what | GPU | CPU |
| --- | --- | --- |
| objects an hour, one thread | 2,000 (2 objects, 1 threads) | 300 (2 objects, 1 threads) |
| objects an hour, several threads | 12,500 (9 objects, 8 threads) | 400 (9 objects, 2 threads) |
"""


@pytest.fixture
def module(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield importlib.import_module("survey_estimate")
    for name in ("survey_estimate", "_results"):
        sys.modules.pop(name, None)


def test_the_estimate_by_hand(module):
    """36 million seconds; 1.5 and 0.4 kB, and a thousandth of a MiB, five million times."""
    cells = {row[0]: row[2] for row in module.estimate(module.figures(TEXT))}
    assert cells["processor time"] == "10,000 core hours"
    assert cells["wall time"] == "208 days, 10 h"
    assert cells["wall time on one GPU"] == "17 days"  # 400 hours
    assert cells["process that hands out objects"].startswith("9 h of processor time")
    assert "1,100 cores" in cells["process that hands out objects"]  # 7.2 s over 6.5 ms
    assert cells["journal"] == "7.5 GB"
    assert cells["table, Parquet"] == "2.0 GB"
    assert cells["memory of that process"] == "5.2 GB"


def test_a_figure_that_is_missing_is_not_made_up(module):
    with pytest.raises(ValueError, match="unpack"):
        module.figures(TEXT.replace("7.2 s", "unknown"))
