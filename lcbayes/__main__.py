"""`python -m lcbayes` is `lcbayes`."""

import sys

from lcbayes.cli.main import main

if __name__ == "__main__":  # the processes of a local Dask cluster import this file
    sys.exit(main())
