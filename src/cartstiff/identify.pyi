"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .wings.identify.identification import Identification as Identification
from .wings.identify.identification import identify as identify
from .wings.identify.measurements import Measurements as Measurements
from .wings.identify.measurements import read_measurements as read_measurements
