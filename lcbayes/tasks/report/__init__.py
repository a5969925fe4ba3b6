"""`lcbayes report`: write the report of a results folder again."""
