"""A result that is loaded without its arrays."""

from __future__ import annotations

import pandas as pd
import pytest

from lcbayes.core.errors import InputError
from lcbayes.tasks.load import SavedResult, load


def saved(**tables: pd.DataFrame) -> SavedResult:
    content = {"task": "spin", "period_s": 23.5, "passes": [1, 2], "trusted": True}
    return SavedResult(content, [], {}, tables)


def test_plain_values_are_the_summary_without_tables():
    result = saved()
    assert dict(result.summary().to_numpy().tolist()) == {
        "task": "spin",
        "period_s": 23.5,
        "trusted": True,
    }
    assert "period_s: 23.5" in result.lines()
    assert result.tables() == {}


def test_the_table_of_solutions_is_the_summary():
    first, second = pd.DataFrame({"a": [1]}), pd.DataFrame({"b": [2]})
    assert saved(passes=first, solutions=second).summary() is second
    assert saved(passes=first, other=second).summary() is first


def test_there_are_no_figures(tmp_path):
    with pytest.raises(InputError, match="lcbayes spin has no figures; run the task again"):
        saved().plot_sky()
    with pytest.raises(InputError, match="lcbayes spin are drawn only when it runs"):
        saved().write_page(tmp_path)
    with pytest.raises(AttributeError, match="no attribute 'shape'"):
        saved().shape  # noqa: B018


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no results of lcbayes"):
        load(tmp_path)
