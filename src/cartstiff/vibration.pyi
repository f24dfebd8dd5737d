"""Public names, with one home each: type checkers and `lazily.public` read them."""

from .answer.vibration.controllers import Impedance as Impedance
from .answer.vibration.controllers import impedance as impedance
from .answer.vibration.response import Damping as Damping
from .answer.vibration.response import FrequencyResponse as FrequencyResponse
from .answer.vibration.response import frequency_response as frequency_response
