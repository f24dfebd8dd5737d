"""A bar of length 1 along x between two hinges about y, as a URDF and a mechanism file."""

from tests.mechanisms.machines import write_file

from cartstiff import load

URDF = """<robot name="bar">
<link name="ground"/><link name="bar"/><link name="tip"/>
<joint name="foot" type="continuous">
<parent link="ground"/><child link="bar"/><axis xyz="0 1 0"/></joint>
<joint name="end" type="continuous">
<parent link="bar"/><child link="tip"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/></joint>
</robot>"""

#: EI = 200 about y and 400 about z, GJ = 160; as good as inextensible.
SECTION = {"E": 2e11, "G": 8e10, "area": 1e-2, "Iy": 1e-9, "Iz": 2e-9, "J": 2e-9}
EI = 200.0


def bar(folder, segments=None, *, hinged=(), **section):
    """The bar, clamped at its foot; the hinges named turn freely, the others are locked."""
    beam = {**SECTION, "length": 1.0, **section}
    if segments is not None:
        beam["segments"] = segments
    return load_bar(folder, {"beam": beam}, hinged)


def load_bar(folder, give, hinged=()):
    """The same with any entry under `flexible`."""
    (folder / "bar.urdf").write_text(URDF, encoding="utf-8")
    locked = {name: 0.0 for name in ("foot", "end") if name not in hinged}
    free = {name: {"stiffness": 0.0, "rest": 0.0} for name in hinged}
    return load(
        write_file(
            folder,
            "bar",
            kind="serial",
            model="bar.urdf",
            frame="tip",
            locked=locked,
            springs=free,
            flexible={"bar": give},
        )
    )
