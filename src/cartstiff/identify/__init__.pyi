"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .identification import Identification as Identification
from .identification import identify as identify
from .measurements import Measurements as Measurements
from .measurements import read_measurements as read_measurements
