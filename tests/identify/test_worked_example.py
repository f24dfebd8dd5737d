"""The how-to's example, from its own words: what it prints is what the commands print."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from tests.support.commands import outcome

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "joint-stiffness.md"


def test_the_worked_example_prints_what_the_page_says(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    seen = 0
    blocks = re.findall(r"```console\n\$ cartstiff (.*?)\n(.*?)```", PAGE.read_text("utf-8"), re.S)
    for command, shown in blocks:
        end, out, error = outcome("", shlex.split(command))
        assert end == 0, error
        printed = out.splitlines()
        for line in shown.splitlines():
            if line and line != "...":
                assert line in printed
                seen += 1
    assert seen >= 11
    code, wanted = re.findall(r"```python\n(.*?)```\n+```text\n(.*?)```", PAGE.read_text(), re.S)[0]
    exec(compile(code, str(PAGE), "exec"), {})
    assert capfd.readouterr().out == wanted
