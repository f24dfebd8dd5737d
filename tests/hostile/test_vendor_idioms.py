"""What makers of robots write in xacro files is still read, with the values that xacro gives."""

import math

import pytest
from tests.doors import read_robot_description

import cartstiff

pytest.importorskip("xacro")

PARTS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="M_PI" value="3.1415926535897931"/>
  <xacro:property name="depth" value="0.25"/>
  <xacro:macro name="joint_of" params="name parent child *origin **inside type:=revolute
      limits:=${config['limits']} prefix:=^|fallback_">
    <link name="${prefix}${child}"/>
    <joint name="${prefix}${name}" type="${type}">
      <xacro:insert_block name="origin"/>
      <parent link="${prefix}${parent}"/> <child link="${prefix}${child}"/>
      <xacro:insert_block name="inside"/>
      <limit lower="${radians(limits['lower'])}" upper="${limits.upper * pi / 180}" effort="1"
        velocity="${limits.list[-1] if limits.list else 0.0}"/>
    </joint>
  </xacro:macro>
</robot>"""
ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="prefix" default="left_"/>
  <xacro:arg name="tool" default="true"/>
  <xacro:arg name="kind" default="$(optenv ARM_KIND big)"/>
  <xacro:property name="prefix" value="$(arg prefix)"/>
  <xacro:property name="tool" value="$(arg tool)"/>
  <xacro:property name="config" value="${load_yaml('$(find arm_description)/config/arm.yaml')}"/>
  <xacro:property name="same" value="${xacro.load_yaml('../config/arm.yaml')}"/>
  <xacro:include filename="$(find arm_description)/urdf/parts.xacro"/>
  <xacro:include filename="parts.xacro" ns="more"/>
  <link name="${prefix}base"/>
  <xacro:joint_of name="shoulder" parent="base" child="upper">
    <origin xyz="0 0 ${depth}" rpy="${M_PI/2} 0 ${-M_PI/2.0}"/>
    <group><axis xyz="0 0 1"/></group>
  </xacro:joint_of>
  <xacro:joint_of name="elbow" parent="upper" child="lower"
      type="${'revolute' if tool else 'fixed'}">
    <origin xyz="${sqrt(0.04)} ${more.depth * sin(pi / 2)}
      ${config.sizes['length'] + 0.5 * same['sizes'].length}"/>
    <group><axis xyz="${'1 0 0' if '$(arg kind)' == 'big' else '0 1 0'}"/></group>
  </xacro:joint_of>
  <xacro:if value="${tool and not prefix == '' and 2 in config['limits']['list']}">
    <link name="${prefix}tool_${'%02d_%s' % (7, 'x')}_${str(len(prefix)) + '_'.join(['a', 'b'])}"/>
    <joint name="${prefix}flange" type="fixed"><parent link="${prefix}lower"/>
      <child
        link="${prefix}tool_${'%02d_%s' % (7, 'x')}_${str(len(prefix)) + '_'.join(['a', 'b'])}"/>
      <origin xyz="${config.offsets[0]} ${config.offsets[1:][0]} ${max(min(1, 2), 0)}"
        rpy="0 ${degrees(0)} ${round(1.26, 1)}"/></joint>
  </xacro:if>
  <xacro:unless value="$(arg tool)"><never/></xacro:unless>
</robot>"""


@pytest.fixture
def package(tmp_path):
    top = tmp_path / "arm_description"
    for name, text in {
        "package.xml": "<package format='2'><name>arm_description</name></package>",
        "urdf/parts.xacro": PARTS,
        "urdf/arm.urdf.xacro": ARM,
        "config/arm.yaml": "limits: {lower: -90, upper: 180.0, list: [1, 2]}\n"
        "sizes: &sizes {length: 1.5}\nother: {<<: *sizes, width: 2}\n"
        "offsets: [!millimeters 250, !degrees 180]\n",
    }.items():
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).write_text(text)
    return top / "urdf" / "arm.urdf.xacro"


def test_a_makers_file(package):
    model = read_robot_description(package).model
    assert list(model.names) == ["universe", "left_shoulder", "left_elbow"]
    assert model.lowerPositionLimit.tolist() == pytest.approx([-math.pi / 2] * 2)
    assert model.upperPositionLimit.tolist() == pytest.approx([math.pi] * 2)
    shoulder, elbow = list(model.jointPlacements)[1:]
    assert shoulder.translation.tolist() == [0, 0, 0.25]
    # Rz(-pi/2) Rx(pi/2), by hand.
    assert shoulder.rotation.round(12).tolist() == [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]
    assert elbow.translation.tolist() == pytest.approx([0.2, 0.25, 2.25])
    tool = model.frames[model.getFrameId("left_tool_07_x_5a_b")]
    assert tool.placement.translation.tolist() == pytest.approx([0.25, math.pi, 1.0])
    assert math.atan2(
        tool.placement.rotation[1, 0], tool.placement.rotation[0, 0]
    ) == pytest.approx(1.3)


def test_arguments_change_it(package):
    arguments = {"prefix": "", "tool": "false", "kind": "small"}
    assert cartstiff.load(package, xacro_args=arguments).names == ("shoulder",)


EXPRESSIONS = [
    ("1 + 2 * 3", "7"),
    ("7 / 2", "3.5"),
    ("7 // 2", "3"),
    ("-7 % 3", "2"),
    ("2**0.5", str(2**0.5)),
    ("1e-3", "0.001"),
    ("radians(180) == pi", "True"),
    ("math.atan2(1, 1)", str(math.pi / 4)),
    ("math.pi", str(math.pi)),
    ("1 < 2 < 3 and not 3 > 4", "True"),
    ("'a' in 'abc'", "True"),
    ("None is None", "True"),
    ("0 or 'x'", "x"),
    ("[1, 2, 3][1]", "2"),
    ("(4, 5)[-1]", "5"),
    ("'abcdef'[1:4]", "bcd"),
    ("'1 2 3'.split()[2]", "3"),
    ("'a,b'.split(',')[0].upper()", "A"),
    ("'prefix_x'.startswith('prefix')", "True"),
    ("'%.3f' % 1.23456", "1.235"),
    ("'%s_%d' % ('a', 3)", "a_3"),
    ("str(1.0) + 'm'", "1.0m"),
    ("int('3') + float('0.5')", "3.5"),
    ("list(map(float, '1 2'.split()))", "[1.0, 2.0]"),
    ("len([1, 2]) + max(1, 3) + min([4, 5]) + abs(-1)", "10"),
    ("dict(a=1, b=dict(c=[2, 3])).b['c'][1]", "3"),
    ("dict(a=1, b=2)['b']", "2"),
    ("dict(a=1).get('z', 'none')", "none"),
    ("'b' in dict(b=1).keys()", "True"),
    ("sorted([3, 1, 2], reverse=True)", "[3, 2, 1]"),
    ("sum(range(1, 5))", "10"),
    ("python.round(1.2345, 2)", "1.23"),
    ("isinstance(1, int)", "True"),
    ("xacro.tokenize('a; b,c')", "['a', 'b', 'c']"),
    ("xacro.arg('given')", "me"),
    ("'x' if True else undefined", "x"),
    ("[[1, 2], [3, 4]][1][0]", "3"),
    ("cos(0) * 2 ** -1", "0.5"),
    ("' '.join(['a', 'b']).replace(' ', '-')", "a-b"),
    ("hypot(3, 4) + ceil(0.2)", "6.0"),
    ("xacro.warning('careful')", ""),
]


def test_expressions_have_the_values_of_xacro(tmp_path):
    """Against Python's own value of the expression, where it is one."""
    file = tmp_path / "e.xacro"
    links = "".join(
        f'<link name="{i}|{text}"/><joint name="{i}" type="fixed"><parent link="a"/>'
        f'<child link="{i}|{text}"/></joint>'
        for i, (expression, _) in enumerate(EXPRESSIONS)
        for text in ("${" + expression.replace("<", "&lt;") + "}",)
    )
    file.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="given" '
        f'default="me"/><link name="a"/>{links}</robot>'
    )
    names = [frame.name for frame in read_robot_description(file).model.frames]
    found = dict(name.split("|", 1) for name in names if "|" in name)
    for i, (expression, value) in enumerate(EXPRESSIONS):
        assert found[str(i)] == value, expression
        if not any(word in expression for word in ("xacro.", "python.", ".b[")):
            space = {**vars(math), "math": math}
            assert str(eval(expression, space)) == value
