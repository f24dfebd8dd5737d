"""Pages made from the code: file format, command help, module lists, gallery; and a role for keys.

Directives, for pages in reStructuredText (``command-help`` for MyST pages as well):

- ``mechanism-file``: the keys of every kind of mechanism file, from the JSON schema;
- ``json-output COMMAND``: the keys of a command's JSON output, from its JSON schema;
- ``quantities``: the table of quantities of maps, paths and designs;
- ``command-help``: what ``--help-all`` prints for every command;
- ``package-modules NAME ...``: API documentation of all modules of packages;
- ``other-modules NAME ...``: the same for all packages that are not named;
- ``state-codes PACKAGE``: the codes of notes and states of a package, with their messages;
- ``import-picture``: the packages and their imports, as SVG;
- ``lines-table``: files and lines of each package;
- ``published-cases``: the cases with their values;
- ``scripts-of-the-day``: the fourteen scripts of the gallery, what they print and draw;
- ``gallery``: one picture and one paragraph for every example.

Role ``key``: a bibliography key, resolved on the page of references.
"""

from __future__ import annotations

import ast
import json
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import draw_architecture
import notebooks
from cases.case import read_cases
from codes import codes
from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole

import cartstiff
from cartstiff.answer.analysis.matrices import PURE
from cartstiff.core.units import SI
from cartstiff.extend import QUANTITIES, file_schema
from cartstiff.extend import json_schema as output_schema
from cartstiff.shown.cli import main as cli
from cartstiff.shown.cli.declare import HELP_ALL

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
GALLERY = ROOT / "docs" / "gallery"


class _Text(SphinxDirective):
    """A directive that writes reStructuredText and has it parsed."""

    has_content = False
    optional_arguments = 100

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        container = nodes.Element()
        lines = StringList(list(self.text()), source=f"<{self.name}>")
        self.state.nested_parse(lines, 0, container, match_titles=True)
        return container.children


# -- the mechanism file -----------------------------------------------------------------------


def _name(reference: str) -> str:
    return reference.rsplit("/", 1)[-1]


def _type(schema: dict[str, Any]) -> str:
    """A JSON schema's type in words."""
    if "$ref" in schema:
        name = _name(schema["$ref"])
        return f":ref:`{name} <{_label(name)}>`"
    if "allOf" in schema:
        return _type(schema["allOf"][0])
    if "anyOf" in schema:
        kinds = [_type(s) for s in schema["anyOf"] if s.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if "enum" in schema:
        return ", ".join(f"``{value}``" for value in schema["enum"])
    if "const" in schema:
        return f"``{schema['const']}``"
    kind = schema.get("type")
    if kind == "array":
        least, most = schema.get("minItems"), schema.get("maxItems")
        inner = _type(schema.get("items", {}))
        inner = f"({inner})" if inner.startswith(("list", "2", "3", "6")) else f"{inner}"
        inner = inner.replace("number", "numbers", 1) if inner.startswith("number") else inner
        return f"{least} {inner}" if least and least == most else f"list of {inner}"
    if kind == "object":
        inner = schema.get("additionalProperties")
        return f"mapping of name to {_type(inner)}" if isinstance(inner, dict) else "mapping"
    if kind == "number":
        if "exclusiveMinimum" in schema:
            return "number above 0"
        return "number, 0 or more" if schema.get("minimum") == 0 else "number"
    return {"string": "text", "boolean": "true or false"}.get(str(kind), str(kind))


def _label(name: str) -> str:
    return f"mechanism-file-{name.lower()}"


def _default(schema: dict[str, Any], required: bool) -> str:
    if required:
        return "required"
    value = schema.get("default")
    if value in (None, {}, []) or isinstance(value, dict):
        return ""
    if isinstance(value, bool):
        return f"``{str(value).lower()}``"
    return f"``{value}``"


class MechanismFile(_Text):
    """Tables of the mechanism file's keys."""

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        schema = file_schema()
        definitions = schema["$defs"]
        kinds = {kind: _name(ref) for kind, ref in schema["discriminator"]["mapping"].items()}
        order = [_name(entry["$ref"]) for entry in schema["oneOf"]]
        order += [n for n in definitions if n not in order]
        titles = {name: f"kind: {kind}" for kind, name in kinds.items()}
        for name in order:
            model = definitions[name]
            title = titles.get(name, name)
            yield from ["", f".. _{_label(name)}:", "", title, "-" * len(title), ""]
            if model.get("description"):
                yield from [model["description"].strip(), ""]
            yield from [".. list-table::", "   :header-rows: 1", "   :widths: 18 34 14 34", ""]
            yield from ["   * - key", "     - value", "     - default", "     - meaning"]
            for key, value in model.get("properties", {}).items():
                cells = [
                    f"``{key}``",
                    _type(value),
                    _default(value, key in model.get("required", [])),
                    value.get("description", ""),
                ]
                yield f"   * - {cells[0]}"
                yield from (f"     - {cell}" for cell in cells[1:])
            yield ""


# -- the JSON output --------------------------------------------------------------------------


def _form(schema: dict[str, Any]) -> str:
    """What a value looks like, in one word or two."""
    if "const" in schema:
        return f"``{json.dumps(schema['const'])}``"
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(map(_form, schema["anyOf"])))
    if "enum" in schema:
        return " or ".join(f"``{json.dumps(value)}``" for value in schema["enum"])
    kinds = schema.get("type", "any")
    names = {"array": "list", "null": "``null``", "boolean": "true or false", "string": "text"}
    names |= {"integer": "number"}
    return " or ".join(names.get(k, k) for k in ([kinds] if isinstance(kinds, str) else kinds))


class JsonOutput(_Text):
    """A table of the keys of a command's JSON output; nested keys stand as ``outer.inner``."""

    def rows(self, properties: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str, str]]:
        """Key, form and meaning."""
        for key, schema in properties.items():
            unit = schema.get("unit", "").replace("{", "").replace("}", "")
            meaning = schema.get("description", "") + (f" [{unit}]" if unit else "")
            yield f"{prefix}{key}", _form(schema), meaning
            if key == "analysis":  # it has a table of its own
                continue
            for kind in (schema, *schema.get("anyOf", ())):
                inner = kind.get("properties") or kind.get("items", {}).get("properties") or {}
                yield from self.rows(inner, f"{prefix}{key}.")

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        command, *without = self.arguments
        left_out = set(output_schema(without[0])["properties"]) if without else set()
        properties = output_schema(command)["properties"]
        properties = {k: v for k, v in properties.items() if k not in left_out}
        yield from [".. list-table::", "   :header-rows: 1", "   :widths: 26 22 52", ""]
        yield from ["   * - key", "     - value", "     - meaning"]
        for key, form, meaning in self.rows(properties):
            yield from [f"   * - ``{key}``", f"     - {form}", f"     - {meaning}"]
        yield ""


class Quantities(_Text):
    """The table of quantities, with SI units."""

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        yield from [".. list-table::", "   :header-rows: 1", "   :widths: 30 14 44 12", ""]
        yield from ["   * - name", "     - unit", "     - meaning", "     - better"]
        for q in QUANTITIES.values():
            unit = "" if q.unit == PURE else q.unit_in(SI)
            yield from [f"   * - ``{q.name}``", f"     - {unit}", f"     - {q.description}"]
            yield f"     - {q.better or ''}"
        yield ""


# -- the command line -------------------------------------------------------------------------


class CommandHelp(SphinxDirective):
    """What --help-all prints for each command, and --help for the group."""

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        group = cli.command
        settings = {"terminal_width": 96, "max_content_width": 96} | {
            "help_option_names": group.context_settings.get("help_option_names", ["--help"])
        }
        with click.Context(group, info_name="cartstiff", **settings) as context:
            helps = {"cartstiff": group.get_help(context)}
            for name in group.list_commands(context):
                command = group.get_command(context, name)
                with click.Context(command, info_name=name, parent=context, **settings) as inner:
                    inner.meta[HELP_ALL] = True
                    helps[f"cartstiff {name}"] = command.get_help(inner)
        found: list[nodes.Node] = []
        for title, text in helps.items():
            section = nodes.section(ids=[nodes.make_id(title)])
            section += nodes.title(title, title)
            section += nodes.literal_block(text, text, language="text")
            found.append(section)
        return found


# -- the API ----------------------------------------------------------------------------------


def modules_of(name: str) -> Iterator[str]:
    """Public modules of a package (or the module itself), in alphabetical order."""
    base = Path(cartstiff.__file__).parent.joinpath(*name.split(".")[1:])
    if not base.is_dir():
        yield name
        return
    if ast.get_docstring(ast.parse((base / "__init__.py").read_text(encoding="utf-8"))):
        yield name
    for info in sorted(pkgutil.iter_modules([str(base)]), key=lambda i: i.name):
        if not info.name.startswith("_"):
            yield from modules_of(f"{name}.{info.name}")


def _has_members(name: str) -> bool:
    base = Path(cartstiff.__file__).parent.joinpath(*name.split(".")[1:])
    if not base.is_dir():  # a home, which has a stub, only leads to names of other modules
        return not base.with_suffix(".pyi").exists()
    tree = ast.parse((base / "__init__.py").read_text(encoding="utf-8"))
    kinds = (ast.FunctionDef, ast.ClassDef)
    # What stands in a branch, as for a type checker, is there too.
    branches = [m for n in tree.body if isinstance(n, ast.If) for m in (*n.body, *n.orelse)]
    members = [n for n in (*tree.body, *branches) if isinstance(n, kinds)]
    return any(not n.name.startswith("_") for n in members)


class PackageModules(_Text):
    """Automatic documentation of every module of some packages."""

    def packages(self) -> list[str]:
        """Names of the packages."""
        return list(self.arguments)

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        for package in self.packages():
            for name in modules_of(package):
                if name == package and not _has_members(name):
                    continue
                yield from ["", name, "-" * len(name), "", f".. automodule:: {name}"]
                yield from ["   :members:", "   :show-inheritance:", ""]


class OtherModules(PackageModules):
    """The packages and modules of cartstiff that no other page names."""

    def packages(self) -> list[str]:
        """Names of the packages."""
        named = tuple(f"{name}." for name in self.arguments)
        base = Path(cartstiff.__file__).parents[1]
        files = (n for n in modules_of("cartstiff") if not base.joinpath(*n.split(".")).is_dir())
        return [name for name in files if not f"{name}.".startswith(named)]


class PublicNames(_Text):
    """The public names of each home beside `cartstiff`, by its stub."""

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        homes = [import_module(f"cartstiff.{home}") for home in self.arguments]
        # A home that is no package has nothing of its own, and no page.
        yield from (f".. py:module:: {m.__name__}" for m in homes if not hasattr(m, "__path__"))
        yield from ["", ".. list-table::", ""]
        for home in self.arguments:
            module, names = import_module(f"cartstiff.{home}"), list[str]()
            for name in module.__all__:
                thing = getattr(module, name)
                place = thing.__module__ if hasattr(thing, "__qualname__") else None
                known = f":py:obj:`{name} <{place}.{name}>`" if place else f"``{name}``"
                names.append(known)
            yield from [f"   * - ``cartstiff.{home}``", f"     - {', '.join(names)}"]


# -- codes of notes and states ----------------------------------------------------------------


class StateCodes(_Text):
    """A table of codes and messages."""

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        found: dict[str, dict[str, str]] = {}
        for package in self.arguments:
            for entry in codes(package):
                found.setdefault(entry.code, {}).setdefault(entry.message, entry.module)
        if not found:
            return
        yield from [".. list-table::", "   :header-rows: 1", "   :widths: 25 50 25", ""]
        yield from ["   * - code", "     - message", "     - module"]
        for code, messages in sorted(found.items()):
            yield f"   * - ``{code}``"
            texts = [m.replace("\\", "\\\\").replace("|", "\\|") for m in messages]
            yield "     - " + "; ".join(t.replace("*", "\\*").replace("`", "'") for t in texts)
            yield "     - " + ", ".join(f"``{m}``" for m in sorted(set(messages.values())))
        yield ""


# -- the gallery ------------------------------------------------------------------------------


class Gallery(_Text):
    """A picture, a paragraph and the command for every example."""

    option_spec = {"width": directives.unchanged}  # noqa: RUF012

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        scripts = [path for path in EXAMPLES.glob("*.py") if path.stem != "make_gallery"]
        for path in sorted([*scripts, *notebooks.FOLDER.glob("*.ipynb")], key=lambda p: p.stem):
            self.env.note_dependency(str(path))
            if path.suffix == ".py":
                doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
                title, _, rest = doc.partition("\n")
                after = ["::", "", f"    python examples/make_gallery.py . {path.stem}"]
            else:
                title, rest = notebooks.heading(path)
                after = [f"A notebook: :doc:`/notebooks/{path.stem}`."]
            title = title.rstrip(".")
            yield from ["", f".. _example-{path.stem}:", "", title, "-" * len(title), ""]
            yield from rest.strip().splitlines()
            yield from ["", f".. image:: images/{path.stem}.png", f"   :alt: {title}", ""]
            yield from [*after, ""]


# -- the picture of imports -------------------------------------------------------------------


class ScriptsOfTheDay(_Text):
    """A script of the gallery with what it prints and draws."""

    def text(self) -> Iterator[str]:
        """The lines, in reStructuredText."""
        for path in sorted(GALLERY.glob("*.py")):
            if path.stem == "__main__":
                continue
            self.env.note_dependency(str(path))
            doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            title, _, rest = doc.partition("\n")
            title = title.partition(":")[0]
            yield from ["", f".. _example-{path.stem}:", "", title, "-" * len(title), ""]
            first = doc.partition(": ")[2].partition("\n")[0]
            yield from [first[:1].upper() + first[1:], ""]
            yield from rest.strip().splitlines()
            yield from ["", f".. image:: images/{path.stem}.png", f"   :alt: {title}", ""]
            for name, language in ((f"{path.stem}.py", "python"), (f"{path.stem}.txt", "text")):
                yield from [f".. literalinclude:: gallery/{name}", f"   :language: {language}"]
                yield from ["   :start-at: import"] if language == "python" else []
                yield ""


class PublishedCases(_Text):
    """A section a case: source, verdict, printed values and ours."""

    def text(self) -> Iterator[str]:
        """The lines."""
        cases = list(read_cases(ROOT / "cases"))
        self.env.note_dependency(str(ROOT / "cases"))
        verdicts = [case.verdict for _, case in cases]
        counts = [f"{verdicts.count(v)} {v}" for v in dict.fromkeys(sorted(verdicts))]
        exact = sum(case.to_the_digit for _, case in cases)
        yield f"{len(cases)} cases: {', '.join(counts)}. {exact} are met to the last printed digit."
        yield ""
        for folder, case in cases:
            yield from (case.title, "-" * len(case.title), "")
            digits = ", to the last printed digit" if case.to_the_digit else ""
            yield f"``{folder.name}``: **{case.verdict}{digits}**. {case.about}"
            if case.reason:
                yield f"*{case.reason}*"
            source = case.source
            link = f" `{source.link} <{source.link}>`__" if source.link else ""
            where = f"{source.work}; {source.place}. Seen: {source.looked_up}.{link}"
            yield from ("", f"Source: {where}", "")
            if not case.asked:
                yield from (f"Missing: {case.inputs['missing']}", "")
                continue
            yield from (
                ".. list-table::",
                "   :header-rows: 1",
                "",
                "   * - value",
                "     - printed",
            )
            yield from ("     - cartstiff", "     -")
            for asked in case.asked:
                yield f"   * - {asked.name}: {asked.what} ({asked.unit})"
                yield f"     - {_numbers(asked.printed)}"
                yield f"     - {_numbers(asked.ours)}"
                yield f"     - {'' if asked.agrees else 'differs: '}{asked.because or ''}"
            yield ""


def _numbers(values: Any) -> str:
    """A short value as it is, of a matrix its shape."""
    if not isinstance(values, list):
        return f"{values:.8g}"
    if isinstance(values[0], list):
        return f"{len(values)} x {len(values[0])} entries"
    return ", ".join(f"{value:.8g}" for value in values)


class ImportPicture(SphinxDirective):
    """The SVG of docs/draw_architecture.py, inside the page."""

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        picture = draw_architecture.svg(draw_architecture.imports())
        return [nodes.raw("", f'<div class="picture">{picture}</div>', format="html")]


class LinesTable(_Text):
    """Files and lines of each package."""

    def text(self) -> Iterator[str]:
        """A list table."""
        yield from (".. list-table::", "   :header-rows: 1", "")
        head = ("package", "files", "lines", "of which code")
        for row in (head, *draw_architecture.sizes()):
            for i, cell in enumerate(row):
                yield f"   {'* -' if i == 0 else '  -'} {cell}"


# -- bibliography keys ------------------------------------------------------------------------


class Key(SphinxRole):
    """A citation such as [ZK], in any page."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """The nodes."""
        label = nodes.inline(self.text, f"[{self.text}]")
        reference = addnodes.pending_xref(
            self.rawtext,
            label,
            refdomain="citation",
            reftype="ref",
            reftarget=self.text,
            refwarn=True,
            support_smartquotes=False,
            classes=["citation"],
        )
        reference["refdoc"] = self.env.docname
        return [reference], []


def setup(app: Sphinx) -> dict[str, Any]:
    """Register directives and the role."""
    app.add_directive("mechanism-file", MechanismFile)
    app.add_directive("json-output", JsonOutput)
    app.add_directive("quantities", Quantities)
    app.add_directive("command-help", CommandHelp)
    app.add_directive("package-modules", PackageModules)
    app.add_directive("public-names", PublicNames)
    app.add_directive("other-modules", OtherModules)
    app.add_directive("state-codes", StateCodes)
    app.add_directive("gallery", Gallery)
    app.add_directive("scripts-of-the-day", ScriptsOfTheDay)
    app.add_directive("published-cases", PublishedCases)
    app.add_directive("import-picture", ImportPicture)
    app.add_directive("lines-table", LinesTable)
    app.add_role("key", Key())
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
