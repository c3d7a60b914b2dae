"""python -m tools.vectors_speed"""

import sys

from tools.vectors_speed import main

sys.exit(main())
