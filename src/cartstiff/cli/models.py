"""``cartstiff models``."""

from __future__ import annotations

import json

import click

from cartstiff.cli.output import say
from cartstiff.cli.types import json_option


@click.command(name="models", epilog="\b\nExample:\n  cartstiff models\n  cartstiff models --json")
@json_option
def command(as_json: bool) -> None:
    """List what can be named as MECHANISM: bundled files and example robots."""
    from cartstiff.loading.catalogue import bundled_files, example_robots
    from cartstiff.loading.yaml_file import read_yaml

    bundled = {name: read_yaml(path)[0] for name, path in bundled_files().items()}
    robots = example_robots()
    if as_json:
        data = {
            "bundled": {
                name: {"kind": file.get("kind"), "description": file.get("description")}
                for name, file in bundled.items()
            },
            "example_robots": [n for n, r in robots.items() if r.path is not None],
        }
        say(json.dumps(data))
        return
    say("Bundled mechanisms:")
    for name, file in bundled.items():
        say(f"  {name:<16} {file.get('kind', ''):<14} {file.get('description', '')}")
    say("")
    if robots:
        names = [n for n, r in robots.items() if r.path is not None]
        say("Robots of example-robot-data:")
        say(click.wrap_text(", ".join(names), 98, "  ", "  ", preserve_paragraphs=False))
    else:
        say("Robots of example-robot-data: none; pip install 'cartstiff[robots]' adds them.")
    say("")
    say("Or a path: a mechanism file (.yaml), .urdf, .xacro, MJCF .xml.")
