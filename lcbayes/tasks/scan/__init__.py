"""`lcbayes scan`: poles, periods and laws of attitude."""
