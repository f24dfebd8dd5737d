"""Compiles one MJCF file with MuJoCo; run as a script in a process of its own
(`compiled`).

A file from an unknown source cannot harm more than that process. The answer is the
compiled model as data, or one line under "error".

Only the parts that statics needs are compiled: textures are left out, and a mesh is read
only where a mass depends on it. A unit tetrahedron replaces every other mesh. MuJoCo
places a mesh by its own centre and reports the centre's place, so the pose of the file's
mesh follows without reading it.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from cartstiff.files.child_process import read_regular, serve

_MEGABYTES, _SECONDS = 2048, 8
# Largest size of an included file, and largest depth of includes.
_MAX_BYTES, _MAX_DEPTH = 64 * 1024 * 1024, 20
_ARENA = 64 * 1024**2
_TETRAHEDRON = [1.0, 1, 1, 1, -1, -1, -1, 1, -1, -1, -1, 1]
_FACES = [0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2]
#: Replaces a mass of zero, which MuJoCo refuses for bodies that move.
NO_MASS = 1e-14

_FIELDS = """
qpos0 qpos_spring key_qpos opt.gravity opt.wind opt.density opt.viscosity
body_parentid body_pos body_quat body_mass body_ipos body_iquat body_inertia body_gravcomp
body_mocapid body_plugin
jnt_type jnt_bodyid jnt_qposadr jnt_pos jnt_axis jnt_limited jnt_range jnt_stiffness
jnt_stiffnesspoly jnt_actfrclimited jnt_actfrcrange jnt_dofadr dof_armature dof_damping
site_bodyid site_pos site_quat
geom_bodyid geom_type geom_group geom_dataid geom_matid geom_pos geom_quat geom_size
geom_rgba mat_rgba mesh_pos mesh_quat
eq_type eq_objtype eq_obj1id eq_obj2id eq_active0 eq_data
tendon_adr tendon_num tendon_limited tendon_stiffness tendon_stiffnesspoly
tendon_lengthspring wrap_type wrap_objid wrap_prm actuator_trntype actuator_trnid
actuator_gear actuator_forcelimited actuator_forcerange actuator_biastype
actuator_biasprm actuator_gaintype actuator_gainprm actuator_dyntype
actuator_ctrllimited actuator_ctrlrange flex_vertadr flex_vertnum flex_vertbodyid
"""
#: Fields whose numbers are replaced by MuJoCo's names of them.
_ENUMERATIONS = {
    "jnt_type": "mjtJoint",
    "geom_type": "mjtGeom",
    "eq_type": "mjtEq",
    "eq_objtype": "mjtObj",
    "wrap_type": "mjtWrap",
    "actuator_biastype": "mjtBias",
    "actuator_gaintype": "mjtGain",
    "actuator_dyntype": "mjtDyn",
}
_NAMED = {
    "body": "body",
    "jnt": "joint",
    "site": "site",
    "mesh": "mesh",
    "key": "key",
    "eq": "equality",
    "tendon": "tendon",
    "actuator": "actuator",
    "flex": "flex",
    "pair": "pair",
}


def compiled(path: str, largest: dict[str, int]) -> dict[str, Any]:
    """Return the compiled model.

    At most `largest` of each count (``nv``, ``nbody``, ...).
    """
    import mujoco

    _check_includes(Path(path), Path(path).parent, [])
    spec = mujoco.MjSpec.from_file(path)
    spec.compiler.fusestatic = False  # keeps the names of bodies that do not move
    spec.compiler.discardvisual = False
    # Compiling sets up a simulation, which needs little memory here: nothing collides.
    spec.memory = _ARENA
    spec.njmax = spec.nconmax = spec.nstack = -1
    meshes, lost = _reduced(mujoco, spec)
    massless = False
    try:
        model = spec.compile()
    except ValueError as error:
        if "mass and inertia of moving bodies" not in str(error):
            raise
        massless = True
        spec.compiler.boundmass = spec.compiler.boundinertia = NO_MASS
        model = spec.compile()
    for key, most in largest.items():
        if (count := int(getattr(model, key))) > most:
            return {"error": "too large", "count": key, "most": most, "got": count}
    data: dict[str, Any] = {"version": mujoco.__version__, "name": spec.modelname}
    for field in _FIELDS.split():
        value: Any = model
        for part in field.split("."):
            value = getattr(value, part, None)
        data[field] = value.tolist() if hasattr(value, "tolist") else value
    for key, kind in _NAMED.items():
        addresses = getattr(model, f"name_{key}adr", [])
        data[f"{kind}_names"] = [_name(model.names, int(a)) for a in addresses]
    for field, kind in _ENUMERATIONS.items():
        names = {int(v): k for k, v in getattr(mujoco, kind).__members__.items()}
        data[field] = [names[value] for value in data[field] or ()]
    bits = mujoco.mjtDisableBit.__members__.items()
    data["disabled"] = [name for name, bit in bits if int(bit) & model.opt.disableflags]
    # Masses up to this bound are the bound's, not the file's.
    data["no_mass"] = NO_MASS if massless else 0.0
    data["meshes"], data["lost_meshes"] = meshes, lost
    return data


def _check_includes(path: Path, folder: Path, above: list[Path]) -> None:
    """Refuse included files that MuJoCo would wait for, and endless includes."""
    if path in above or len(above) > _MAX_DEPTH:
        raise ValueError(f"{path.name} includes itself")
    text = read_regular(str(path), _MAX_BYTES)
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise ValueError(
            f"XML document types and entities are not supported, in {path.name}"
        )
    for name in re.findall(
        rb"<(?:include|model)\b[^>]*?\bfile\s*=\s*[\"']([^\"']*)", text
    ):
        for near in {folder, path.parent}:
            if (inner := near / os.fsdecode(name)).exists():
                _check_includes(inner, folder, [*above, path])


def _name(names: bytes, start: int) -> str:
    return names[start : names.index(b"\0", start)].decode("utf-8", "backslashreplace")


def _reduced(mujoco: Any, spec: Any) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """Remove costly parts without effect; return mesh files,
    and missing meshes with their bodies.

    The second maps the file of each missing mesh on which a mass depends to the bodies
    that lack the mass.
    """
    for texture in spec.textures:
        texture.file = ""
        texture.cubefiles = [""] * len(texture.cubefiles)
        texture.builtin, texture.width, texture.height = (
            mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            1,
            1,
        )
    for skin in list(spec.skins):
        spec.delete(skin)
    for field in spec.hfields:
        if field.file:
            field.file, field.nrow, field.ncol, field.userdata = (
                "",
                2,
                2,
                [0.0, 0.0, 1.0, 1.0],
            )
    heavy_by_mesh: dict[str, list[Any]] = {}
    for geom in (geoms := list(spec.geoms)):
        # Nothing collides here, so that no hulls are needed.
        geom.contype = geom.conaffinity = 0
        if geom.meshname and _has_mass(mujoco, geom):
            heavy_by_mesh.setdefault(geom.meshname, []).append(geom)
    fitted = {
        g.meshname for g in geoms if g.meshname and g.type not in _mesh_types(mujoco)
    }
    files: dict[str, Any] = {}
    lost: dict[str, list[str]] = {}
    for mesh in spec.meshes:
        if not mesh.file or mesh.plugin.active:
            continue
        file = _mesh_file(spec, mesh)
        there = file.is_file()
        files[mesh.name] = {
            "file": str(file),
            "there": there,
            "scale": list(map(float, mesh.scale)),
            "refpos": list(map(float, mesh.refpos)),
            "refquat": list(map(float, mesh.refquat)),
        }
        heavy = heavy_by_mesh.get(mesh.name, [])
        if there and (heavy or mesh.name in fitted):
            continue
        if heavy:
            lost[file.name] = sorted({g.parent.name or "without a name" for g in heavy})
        mesh.file, mesh.content_type = "", ""
        mesh.scale, mesh.refpos, mesh.refquat = [1.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0, 0.0]
        mesh.uservert, mesh.userface = _TETRAHEDRON, _FACES
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
        for geom in heavy:
            geom.mass = 0.0
    return files, lost


def _mesh_types(mujoco: Any) -> tuple[Any, Any]:
    return mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF


def _has_mass(mujoco: Any, geom: Any) -> bool:
    """Whether the inertia of a geom's body is taken from it."""
    compiler = geom.compiler if hasattr(geom, "compiler") else None
    inferred = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    if compiler is not None:
        inferred = compiler.inertiafromgeom
        low, high = compiler.inertiagrouprange
        if not low <= geom.group <= high:
            return False
    if inferred == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
        return False
    body = geom.parent
    explicit = inferred != mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if not body.parent or (explicit and body.explicitinertial):
        return False
    return bool(geom.mass != 0.0 and (geom.mass > 0.0 or geom.density != 0.0))


def _mesh_file(spec: Any, mesh: Any) -> Path:
    compiler = getattr(mesh, "compiler", None)
    folder = spec.meshdir if compiler is None else compiler.meshdir or spec.meshdir
    name = Path(mesh.file).name if spec.strippath else mesh.file
    return Path(spec.modelfiledir, folder, name)


if __name__ == "__main__":
    serve(compiled, _MEGABYTES, _SECONDS)
