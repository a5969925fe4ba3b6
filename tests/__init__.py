"""The tests of lcbayes; `docs/architecture.md` says which are where."""
