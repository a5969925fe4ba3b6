"""`lcbayes scan`: poles, periods and attitude laws."""
