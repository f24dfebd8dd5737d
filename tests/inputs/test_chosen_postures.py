"""The note on a posture that was chosen says what was not given, and nothing else."""

import cartstiff

# Six joints, singular at zero.
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
PLACES = ("0 0 .16", "0 .14 0", "0 -.13 .42", "0 0 .39", "0 .13 0", "0 0 .1")


def arm():
    links = "".join(f'<link name="l{i}"/>' for i in range(7))
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{place}"/><axis xyz="{axis}"/></joint>'
        for i, (axis, place) in enumerate(zip(AXES, PLACES, strict=True))
    )
    return cartstiff.load(f'<robot name="r">{links}{joints}</robot>')


def notes(elastic, q):
    return [n for n in cartstiff.analyse(elastic, q).notes if n.code == "default-posture"]


def test_who_gives_all_joints_reads_no_such_note():
    elastic = arm()
    (note,) = notes(elastic, None)
    assert "no posture was given" in note.message
    assert notes(elastic, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]) == []
    assert notes(elastic, {f"j{i}": 0.1 * i for i in range(6)}) == []


def test_who_names_some_joints_reads_where_the_others_are():
    elastic = arm()
    (note,) = notes(elastic, {"j2": 1.2})
    result = cartstiff.analyse(elastic, {"j2": 1.2})
    assert result.q[2] == 1.2
    assert note.values["taken"] == {
        name: x for name, x in zip(elastic.names, result.q, strict=True) if name != "j2"
    }
    assert "no position was given for some joints" in note.message
