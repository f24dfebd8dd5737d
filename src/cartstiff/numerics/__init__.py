"""The numeric policy, and inverses, bases and eigenvalues that keep the digits
that are there. Searches are imported from their own modules.
"""

# ruff: noqa: F403 - each module says what it holds

from cartstiff.numerics.bases import *
from cartstiff.numerics.criteria import *
from cartstiff.numerics.inverses import *
from cartstiff.numerics.policy import *
from cartstiff.numerics.spectra import *
from cartstiff.numerics.threads import *
