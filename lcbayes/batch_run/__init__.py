"""Many objects, one fit each: `objects` reads what is asked, `work` does one, `table` tells."""
