"""What is done with results: figures, tables and pages. Nothing here changes a number."""
