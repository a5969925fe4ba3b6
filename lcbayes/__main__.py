"""`python -m lcbayes` is `lcbayes`."""

import sys

from lcbayes.cli import main

sys.exit(main())
