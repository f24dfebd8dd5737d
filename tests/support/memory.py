"""Memory that the children of a process take.

A child counts what its parent held when it was forked, so a process that has run many tests cannot
measure its own children: a fresh one does.
"""

from __future__ import annotations

import json
import subprocess
import sys

_MEASURE = """
import json, resource, sys
from cartstiff import InputError
{0}
for argument in json.loads(sys.argv[1]):
    try:
        ask(argument)
    except InputError:
        pass
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024)
"""


def megabytes_of_children(code: str, arguments: list[object]) -> int:
    """Most memory of any process that `ask(argument)`, defined by the code, starts."""
    command = [sys.executable, "-c", _MEASURE.format(code), json.dumps(arguments, default=str)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(done.stdout.splitlines()[-1])
