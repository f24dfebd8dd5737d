"""The numeric policy, and inverses, bases and eigenvalues that keep the digits
that are there. Searches are imported from their own modules.
"""

# ruff: noqa: F403 - each module says what it holds

from cartstiff.core.numerics.bases import *
from cartstiff.core.numerics.criteria import *
from cartstiff.core.numerics.inverses import *
from cartstiff.core.numerics.policy import *
from cartstiff.core.numerics.spectra import *
from cartstiff.core.numerics.threads import *
