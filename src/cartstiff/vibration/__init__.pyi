"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .controllers import Impedance as Impedance
from .controllers import impedance as impedance
from .response import Damping as Damping
from .response import FrequencyResponse as FrequencyResponse
from .response import frequency_response as frequency_response
