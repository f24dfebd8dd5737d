"""A number that stands alone may carry its unit; numbers of a list are plain."""

import pytest
from tests.support.commands import answer, run


@pytest.mark.parametrize(
    ("command", "plain", "given"),
    [
        ("equilibrium ur5", "--payload 3", ["--payload", "3 kg"]),
        ("equilibrium ur5", "--payload 3", ["--payload=3000 g"]),
        ("analyse ur5", "--length 0.2", ["--length", "200 mm"]),
        ("analyse stewart-gough", "--length 20", ["--length", "0.2m"]),
        ("identify ur5 --plan 3 --sd d=5um", "--mass 5", ["--mass", "5kg"]),
        ("identify ur5 --plan 3 --sd d=5um", "--force 100", ["--force", "0.1 kN"]),
    ],
)
def test_a_unit_is_converted(command, plain, given):
    assert answer(command, given) == answer(command, plain)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["equilibrium ur5", ["--payload", "3 mm"]], "--payload: unknown unit"),
        (["equilibrium ur5", ["--payload", "3 kg,0,0,0.1"]], "not a finite number"),
        (["analyse ur5", ["--length", "2 kg"]], "--length: unknown unit"),
        (["analyse ur5", ["--load", "0,0,0,0,0,100 N"]], "not a finite number"),
    ],
)
def test_what_is_refused(words, said):
    assert said in run(*words, code=2)
