"""What is refused, and with which words: the rows of `refusals.yaml`."""

import json
import shlex
from copy import deepcopy
from pathlib import Path

import yaml


def cases():
    """Of every row: its section, the words of a command, words of the answer, and files by name."""
    text = Path(__file__).with_name("refusals.yaml").read_text(encoding="utf-8")
    for name, section in yaml.safe_load(text).items():
        files = section.get("files", {})
        for end, says, *more in section["rows"]:
            own = {n: _changed(files.get(n), now) for n, now in (more[0] if more else {}).items()}
            run = shlex.split(f"{section.get('run', '')} {end}")
            yield name, run, [says] if isinstance(says, str) else says, files | own


def _changed(was, now):
    if isinstance(now, list):
        assert now[0] in was
        return was.replace(*now)
    if not isinstance(now, dict):
        return now
    new = deepcopy(was or {})
    for path, value in now.items():
        *above, key = path.split(".")
        place = new
        for step in above:
            place = place[step]
        place[key] = value
        if value is None:
            del place[key]
    return new


def write(files):
    """Write files by name here: texts, and mappings as JSON, which is YAML; "name/" is a folder."""
    for name, content in files.items():
        if name.endswith("/"):
            Path(name).mkdir()
            continue
        text = content if isinstance(content, str) else json.dumps(content)
        Path(name).write_text(text, encoding="utf-8")
