"""`lcbayes report`: the report of a results folder again."""
