"""The numeric policy, and inverses, bases and eigenvalues that keep the digits
that are there.
"""

# ruff: noqa: F403 - each module says what it holds

from cartstiff.numerics.bases import *
from cartstiff.numerics.criteria import *
from cartstiff.numerics.inverses import *
from cartstiff.numerics.policy import *
from cartstiff.numerics.searches import *
from cartstiff.numerics.shortest import *
from cartstiff.numerics.spectra import *
from cartstiff.numerics.threads import *
