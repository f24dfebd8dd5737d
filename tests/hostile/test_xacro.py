"""Robot files of strangers that want more than to describe a robot: refused, or harmless.

Each file may try to leave a marker, or to bring a secret of the environment or of a file outside of
its folder into a name. Both are looked for from outside.
"""

import json
import os
import subprocess
import sys

import pytest
from tests.doors import PACKAGE, read_robot_description
from tests.support.memory import megabytes_of_children

import cartstiff
from cartstiff import InputError

pytest.importorskip("xacro")

SECRET = "sesame4711"
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = (
    '<link name="a"/><link name="{}"/><joint name="j" type="continuous"><parent link="a"/>'
    '<child link="{}"/><axis xyz="0 0 1"/></joint></robot>'
)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder of the robot, beside it secrets."""
    folder = tmp_path / "robot"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text(SECRET)
    (tmp_path / "secret.yaml").write_text(f"key: {SECRET}\n")
    (tmp_path / "secret.xacro").write_text(
        f'{HEAD}<xacro:property name="s" value="{SECRET}"/></robot>'
    )
    (folder / "inside.yaml").write_text("key: fine\nlist: [1, {deep: 2}]\nangle: !degrees 90\n")
    monkeypatch.setenv("CARTSTIFF_SECRET", SECRET)
    return folder


def names_of(file):
    """Names in the robot that a file describes."""
    return [frame.name for frame in read_robot_description(file).model.frames]


def written(folder, body, name="x", ending="xacro"):
    file = folder / f"evil.{ending}"
    file.write_text(HEAD + body + ARM.format(name, name), encoding="utf-8")
    return file


def refused(file):
    """The line that refuses a file."""
    marker = file.parent.parent / "marker"
    with pytest.raises(InputError) as caught:
        names_of(file)
    assert not marker.exists()
    words = str(caught.value)
    assert SECRET not in words
    assert "\n" not in words
    return words


LOADS = """
import cartstiff
def ask(file):
    cartstiff.load(file)
    raise AssertionError(f"{file} was read")
"""

RUN = "__import__('os').system('touch MARKER')"
ESCAPES = [
    RUN,
    "(lambda: " + RUN + ")()",
    "(lambda f: f.__globals__)(xacro.load_yaml)",
    "[c for c in ().__class__.__base__.__subclasses__()]",
    "[x for x in [1]][0]",
    "list(c for c in 'ab')",
    "().__class__.__mro__[1].__subclasses__()[0]",
    "''.__class__",
    "().__getattribute__('__class__')",
    "xacro.load_yaml.__globals__['os'].environ",
    "xacro.load_yaml.func_globals",
    "math.__loader__",
    "math.sin.__self__",
    "python.type('')",
    "type('X', (object,), dict(a=1))",
    "python.vars(xacro)",
    "vars()",
    "globals()",
    "locals()",
    "dir()",
    "getattr('', 'format')",
    "python.getattr('', 'format')",
    "eval('1')",
    "exec('1')",
    "compile('1', '', 'eval')",
    "open('MARKER', 'w')",
    "input()",
    "breakpoint()",
    "print('x')",
    "help()",
    "exit()",
    "''.format",
    "'%s'.format(1)",
    "str.format",
    "str.__add__('a', 'b')",
    "str.join(',', ['a'])",
    "f'abc'",
    "f'{().__class__",
    "(x := 1)",
    "(yield 1)",
    "(await 1)",
    "b'abc'",
    "...",
    "max([1, 2], key=lambda n: n)",
    "max([1, 2], key=open)",
    "map(lambda n: n, [1])",
    "map(open, ['MARKER'])",
    "map(eval, ['1'])",
    "list(map(xacro.load_yaml, ['../secret.yaml']))",
    "python.filter(open, ['MARKER'])",
    "[open][0]('MARKER', 'w')",
    "dict(f=open)['f']('MARKER', 'w')",
    "(open if 1 else 0)('MARKER', 'w')",
    "(open or 0)('MARKER', 'w')",
    "dict.fromkeys([1])",
    "[1].append(2)",
    "dict(a=1).update(dict(b=2))",
    "dict(a=1).pop('a')",
    "*[1, 2]",
    "max(*[1, 2])",
    "dict(**dict(a=1))",
    "1; import os",
    "import os",
    "lambda: 0",
    "not_there",
    "_global_symbols",
    "__builtins__",
    "__import__",
    "symbols",
    "self",
    "math",
    "xacro",
    "xacro.os",
    "xacro.substitution_args_context",
    "xacro.arg.__globals__",
    "os.environ",
    "abs",
    "(1).real",
    "(1.5).hex()",
    "'a'.encode()",
    "'a'.translate(dict())",
    "'a'.zfill(999999999)",
    "'a'.ljust(999999999)",
    "ａｂｓ.__ｃｌａｓｓ__",
    "().__ｃlass__",
]


# Evaluates every line of standard input in one process, as the worker does.
EVALUATE = """
import json, runpy, sys
worker = runpy.run_path(sys.argv[1])
reader = worker["_Reader"](sys.argv[2], [], [])
reader.take_over()
answers = []
for expression in json.load(sys.stdin):
    try:
        answers.append(repr(reader.evaluate(expression, {"p": "text", "d": {"a": 1}})))
    except worker["RefusedError"] as error:
        answers.append(f"refused: {error}")
print(json.dumps(answers))
"""


def evaluated(place, expressions):
    """What becomes of expressions; the marker that they try to leave is not there."""
    marker = place.parent / "marker"
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            EVALUATE,
            str(PACKAGE / "files/xacro_worker.py"),
            "/x",
        ],
        input=json.dumps([e.replace("MARKER", str(marker)) for e in expressions]),
        capture_output=True,
        text=True,
        check=True,
    )
    assert not marker.exists()
    return json.loads(done.stdout)


def test_expressions_that_escape_are_refused_by_their_name(place):
    for expression, answer in zip(ESCAPES, evaluated(place, ESCAPES), strict=True):
        assert answer.startswith("refused: "), expression
        assert "${" in answer, expression


@pytest.mark.parametrize("expression", ESCAPES[1:4])
def test_an_escape_in_a_file_is_refused(place, expression):
    expression = expression.replace("MARKER", str(place.parent / "marker"))
    words = refused(written(place, f'<xacro:property name="p" value="${{{expression}}}"/>', "${p}"))
    assert "xacro: " in words
    assert "${" in words


HUGE = [
    "9**9**9",
    "2**100000",
    "'a' * 10**9",
    "10**9 * 'a'",
    "[0] * 10**9",
    "'%999999999d' % 1",
    "'%.999999999f' % 1",
    "'%*d' % (999999999, 1)",
    "range(10**9)",
    "list(range(10**9))",
    "sum(range(10**12))",
    "('a' * 999999) * 999",
    "','.join(['a' * 999999] * 999999)",
    "('a' * 999999).replace('a', 'b' * 999999)",
    "repr(['a' * 999999] * 9999)",
    "str([['a' * 99999] * 9999] * 9999)",
    "round(1, -10**9) + 10**9999",
    "(-1)**0.5",
    "1e308 * 10 ** 400",
    "int('9' * 100000)",
    "'(' * 9 + " + "(" * 3000,
    "-" * 9000 + "1",
    "[" * 3000 + "]" * 3000,
    "1" + "+1" * 4000,
]


@pytest.mark.parametrize("expression", HUGE, ids=range(len(HUGE)))
def test_huge_values_are_refused(place, expression):
    refused(written(place, "", "${" + expression + "}"))


def test_no_process_took_more_memory_than_it_may(place):
    """Of two that would take all there is."""
    laughs = "".join(
        f'<xacro:property name="a{i + 1}" value="{f"${{a{i}}}" * 10}"/>' for i in range(12)
    )
    doublings = "".join(
        f'<xacro:macro name="m{i + 1}"><xacro:m{i}/><xacro:m{i}/></xacro:macro>' for i in range(30)
    )
    doublings = '<xacro:macro name="m0">' + "<b/>" * 3000 + "</xacro:macro>" + doublings
    files = [
        written(place, '<xacro:property name="a0" value="ha"/>' + laughs, "${a12}", "urdf.xacro"),
        written(place, doublings + "<xacro:m30/>"),
    ]
    assert megabytes_of_children(LOADS, files) < 700


@pytest.mark.parametrize(
    "body",
    [
        '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>',
        '<xacro:property name="p" value="${q}"/><xacro:property name="q" value="${p}"/>${p}',
        '<xacro:include filename="evil.xacro"/>',
    ],
)
def test_recursion_comes_to_an_end(place, body):
    refused(written(place, body))


@pytest.mark.parametrize(
    "extension",
    [
        "$(env CARTSTIFF_SECRET)",
        "$(eval env('CARTSTIFF_SECRET'))",
        "$(eval __import__('os'))",
        "$(eval open('/etc/passwd'))",
        "$(eval unknown)",
        "$(eval find('x'))",
        "$(anon x)",
        "$(cwd)",
        "$(find ..)",
        "$(find .)",
        "$(find robot/..)",
        "$(find /)",
        "$(find /etc)",
        "$(find ../..)",
        "$(find a b)",
        "$(find)",
        "$()",
        "$(arg)",
        "$(arg x)",
        "$(load-file x)",
    ],
)
def test_substitutions_other_than_arguments_and_packages_are_refused(place, extension):
    refused(written(place, "", extension))


def test_the_environment_is_empty(place):
    file = written(place, "", "x_$(optenv CARTSTIFF_SECRET y)_$(optenv HOME none)_$(optenv PATH)")
    assert names_of(file)[-1] == "x_y_none_"


OUTSIDE = [
    "../secret.yaml",
    "{top}/secret.yaml",
    "../robot/../secret.yaml",
    "/etc/passwd",
    "/proc/self/environ",
    "/proc/self/fd/0",
    "/dev/zero",
    "/dev/stdin",
    "~/.netrc",
    "file:///etc/passwd",
    "$(dirname)/../secret.yaml",
    "link.yaml",
    "linked/secret.yaml",
    "pipe",
    "hard/../../secret.yaml",
    "",
    ".",
    "*/../../secret.yaml",
]


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("way", ["load_yaml", "include"])
def test_files_outside_are_not_read(place, name, way):
    (place / "link.yaml").symlink_to(place.parent / "secret.yaml")
    (place / "linked").symlink_to(place.parent)
    (place / "hard").mkdir()
    os.mkfifo(place / "pipe")
    name = name.format(top=place.parent)
    if way == "load_yaml":
        refused(written(place, "", f"${{xacro.load_yaml('{name}')['key']}}"))
        return
    optional = written(place, f'<xacro:include filename="{name}" optional="true"/>', "${s}")
    refused(optional)
    refused(written(place, f'<xacro:include filename="{name}"/>', "${s}"))


@pytest.mark.parametrize(
    "pattern", ["../*.xacro", "/etc/pass*", "../[s]ecret.xacro", "../secre?.xacro"]
)
def test_patterns_of_files_outside_match_nothing(place, pattern):
    refused(written(place, f'<xacro:include filename="{pattern}"/>', "${s}"))


def test_a_package_is_no_way_to_folders_that_are_none(place):
    """Folders above and beside the file that are no packages, by their names."""
    (place.parent / "Documents").mkdir()
    (place.parent / "Documents" / "secret.yaml").write_text(f"key: {SECRET}\n")
    for name in (place.parent.name, "Documents", "robot", "tmp", "home", "etc"):
        words = refused(
            written(place, "", f"${{xacro.load_yaml('$(find {name})/secret.yaml')['key']}}")
        )
        assert "is not found" in words


def test_a_mechanism_file_names_no_folders_in_the_users_stead(place):
    """A stranger's YAML beside a stranger's xacro."""
    import cartstiff

    written(place, "", "${xacro.load_yaml('../secret.yaml')['key']}")
    file = place / "arm.yaml"
    file.write_text(f"kind: serial\nmodel: evil.xacro\npackage_path: ['{place.parent}', '/']\n")
    with pytest.raises(InputError, match="is outside of the file's package"):
        cartstiff.load(file)
    assert cartstiff.load(file, package_path=[place.parent]).mechanism.frame == SECRET


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "a: !!python/object/apply:os.system ['touch MARKER']",
            "could not determine a constructor",
        ),
        ("a: !!python/name:os.system", "could not determine a constructor"),
        ("a: !!python/module:os", "could not determine a constructor"),
        ("a: !include ../secret.yaml", "could not determine a constructor"),
        ("a: !degrees __import__('os').system('touch MARKER')", "is not called"),
        ('a: !radians "(lambda: 1)()"', "is not called"),
        ("a: !meters 9**9**9", "too large"),
        ("a: &a [1, *a]", "too much memory"),
        (
            "a0: &a0 [1]\n"
            + "".join(f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]\n" for i in range(9)),
            "too large",
        ),
        ("a: " + "[" * 1500 + "]" * 1500, "too much memory"),
        ("a: {b: 1", "expected ',' or '}'"),
        ("\0", "not"),
    ],
)
def test_yaml_is_data(place, text, words):
    marker = place.parent / "marker"
    (place / "data.yaml").write_text(text.replace("MARKER", str(marker)))
    assert words in refused(written(place, "", "${xacro.load_yaml('data.yaml')}"))


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE r [<!ENTITY s SYSTEM "../secret.txt">]><r><link name="&s;"/></r>',
        '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><r><link name="&b;"/></r>',
        '<!DOCTYPE r SYSTEM "http://localhost/x.dtd"><r/>',
    ],
)
def test_document_types_are_refused_in_included_files(place, text):
    (place / "part.xacro").write_text(text)
    file = written(place, '<xacro:include filename="part.xacro"/>')
    assert "document types" in refused(file)
    (place / "part.xacro").write_bytes(text.encode("utf-16"))
    refused(file)


@pytest.mark.parametrize("ending", ["urdf", "xml", "xacro", "urdf.xacro"])
def test_every_ending_and_every_door_is_guarded(place, ending):
    import cartstiff

    marker = place.parent / "marker"
    file = written(
        place, "", "${(lambda: __import__('os').system('touch " + str(marker) + "'))()}", ending
    )
    (place / "arm.yaml").write_text(f"kind: serial\nmodel: {file.name}\n")
    for source in (file, place / "arm.yaml", file.read_text()):
        with pytest.raises(InputError, match="is not called"):
            cartstiff.load(source)
    assert not marker.exists()


def test_a_property_named_like_a_function_is_no_function(place):
    names = "".join(
        f'<xacro:property name="{name}" value="${{\'abc\'}}"/>' for name in ("len", "str", "f")
    )
    assert names_of(written(place, names, "${len}${len('four')}"))[-1] == "abc4"
    assert "is not called" in refused(written(place, names, "${f('x')}"))


def test_arguments_of_the_user_are_data(place):
    file = written(place, '<xacro:arg name="n" default="x"/>', "$(arg n)")
    arguments = {"n": "${1 + 1}"}
    arm = cartstiff.load(file, xacro_args=arguments)
    assert arm.mechanism.frame == "${1 + 1}"


def test_a_file_beside_the_script_replaces_no_module_of_python(place, monkeypatch):
    """The worker starts although the path of modules begins with a stranger's folder."""
    marker = place.parent / "marker"
    for name in ("types", "ast", "json", "enum", "re"):
        (place / f"{name}.py").write_text(f"open({str(marker)!r}, 'w')\n")
    monkeypatch.syspath_prepend(str(place))
    assert names_of(written(place, "", "x${1 + 1}"))[-1] == "x2"
    assert not marker.exists()
