"""From a name or a file to an elastic mechanism."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from cartstiff.errors import InputError, UnknownNameError, one_line
from cartstiff.loading.catalogue import (
    bundled,
    bundled_files,
    example_robot,
    example_robots,
)
from cartstiff.mechanisms.elastic import ElasticMechanism, Note

__all__ = ["load"]


def load(
    source: Any,
    *,
    frame: str | None = None,
    locked: Mapping[str, float] | None = None,
    stiffness: float | Mapping[str, float] | ArrayLike | None = None,
    rest: float | Mapping[str, float] | ArrayLike | None = None,
    xacro_args: Mapping[str, str] | None = None,
    package_path: Sequence[str | Path] = (),
    **given: Any,
) -> ElasticMechanism:
    """Load a mechanism.

    Parameters
    ----------
    source : str, Path, pinocchio.Model, pinocchio.RobotWrapper or tuple
        A bundled mechanism ("stewart-gough"), a mechanism file (.yaml), a URDF, xacro or MJCF
        file, XML text, or the name of a robot of example-robot-data ("panda") or of
        robot_descriptions ("ur5e_description"), looked up in this order; or what Pinocchio has in
        hand: a model, a wrapper, or a tuple (model, collision model, visual model).
    frame : str, optional
        The frame of interest, instead of the file's.
    locked : mapping of str to float, optional
        Positions (rad, m) of joints that do not move; for serial arms and closed chains.
    stiffness, rest : float, mapping of str to float, or array_like, optional
        Of the joint springs, as in `ElasticMechanism.with_springs`.
    xacro_args : mapping of str to str, optional
        Arguments of a xacro file, such as ``{"ur_type": "ur5e"}``.
    package_path : sequence of str or Path, optional
        Folders in or under which ROS packages are looked for, before ROS_PACKAGE_PATH,
        AMENT_PREFIX_PATH and the folders above the file.
    **given
        For Pinocchio's models, see `cartstiff.loading.pinocchio_model.from_pinocchio`: `visual`,
        `q`, `closures`, `actuated`, `name`.

    Returns
    -------
    ElasticMechanism
        Mechanism, springs, default posture, and notes on what was assumed.

    Raises
    ------
    InputError
        What is wrong, where, what was expected, what was got.
    """
    if frame is not None and not isinstance(frame, str):
        raise InputError("frame is not a name", expected="text", got=frame)
    if isinstance(source, (str, Path)):
        if given:
            raise InputError(
                f"{min(given)!r} belongs to Pinocchio's models only",
                where=one_line(str(source)),
                expected="frame, locked, stiffness, rest",
            )
        ros = _ros_keys(xacro_args, package_path)
        loaded = _from_name(source, frame, dict(locked or {}), ros)
    else:
        from cartstiff.loading.pinocchio_model import from_pinocchio, is_pinocchio

        if xacro_args or package_path:
            raise InputError("xacro_args and package_path belong to files",
                             got=type(source).__name__)  # fmt: skip
        if not is_pinocchio(source):
            raise InputError(
                "mechanism is neither a name nor a path nor a Pinocchio model",
                expected="str, Path, pinocchio.Model, RobotWrapper or a tuple of models",
                got=type(source).__name__,
            )
        loaded = from_pinocchio(source, frame=frame, locked=locked, **given)
    return loaded.with_springs(stiffness, rest)


def _ros_keys(arguments: Any, folders: Any) -> dict[str, Any]:
    """Keys of a mechanism file that say the same."""
    folders = [folders] if isinstance(folders, (str, Path)) else list(folders)
    keys: dict[str, Any] = {}
    if arguments:
        if not isinstance(arguments, Mapping):
            raise InputError("xacro_args is no mapping", expected="names and values",
                             got=type(arguments).__name__)  # fmt: skip
        keys["xacro"] = {
            str(k): str(v).lower() if isinstance(v, bool) else str(v) for k, v in arguments.items()
        }
    for folder in folders:
        if not isinstance(folder, (str, Path)) or not Path(folder).expanduser().is_dir():
            raise InputError("no such folder", where="--package-path", got=one_line(str(folder)))
    if folders:
        keys["package_path"] = [str(Path(folder).expanduser().resolve()) for folder in folders]
    return keys


def _from_name(
    source: str | Path, frame: str | None, locked: dict[str, float], ros: dict[str, Any]
) -> ElasticMechanism:
    """A mechanism by its name or path, or XML text."""
    from cartstiff.loading.ros import ROBOT_FILES, is_description_name

    text = str(source)
    if not text.strip() or "\0" in text:
        raise InputError("mechanism has no name", expected="a name or a path", got=repr(text))
    if isinstance(source, str) and text.lstrip().startswith("<"):
        return _from_robot(text, "robot", frame, locked, ros)
    try:
        path = Path(text).expanduser()
        exists = path.exists()
    except (RuntimeError, OSError) as error:
        raise InputError("not a usable path", where=one_line(text), got=str(error)) from None
    file = bundled(text)
    if file is not None:
        return _from_file(file, frame, locked, ros)
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return _from_file(path, frame, locked, ros)
    if suffix in ROBOT_FILES:
        return _from_robot(str(path), path.stem.removesuffix(".urdf"), frame, locked, ros)
    robots = example_robots()
    if text in robots or (is_description_name(text) and not exists):
        return _from_robot(text, text, frame, locked, ros)
    if exists:
        raise InputError(
            "is a directory" if path.is_dir() else "unknown kind of file",
            where=one_line(text),
            expected=".yaml, .urdf, .xacro or MJCF .xml",
        )
    if not robots and text.isidentifier():
        example_robot(text)  # says how to install the robots that this name may be one of
    raise UnknownNameError("mechanism", text, [*bundled_files(), *robots])


def _from_robot(
    model: str, name: str, frame: str | None, locked: dict[str, float], ros: dict[str, Any]
) -> ElasticMechanism:
    from cartstiff.loading.build import serial_of
    from cartstiff.loading.build_closed import closed_chain_of
    from cartstiff.loading.defaults import default_frame
    from cartstiff.loading.parts import described, joints_that_move
    from cartstiff.loading.schema import ClosedChainFile, SerialFile

    keys: dict[str, Any] = {"model": model, "frame": frame, "locked": locked, **ros}
    description = described(SerialFile.model_construct(kind="serial", **keys), None)
    facts = description.facts
    where = "XML text" if model.lstrip().startswith("<") else one_line(model)
    said = []
    if facts.gravity is not None:
        keys["gravity"] = facts.gravity.tolist()
        shown = ", ".join(f"{g:g}" for g in facts.gravity)
        words = f"gravity ({shown}) m/s^2 acts, as the MJCF file says"
        said.append(Note("gravity-of-file", words, {"gravity": keys["gravity"]}))
    if facts.closures:
        moving = joints_that_move(description, frame or default_frame(description.model)[0])
        if any(tie.joints & moving for tie in facts.closures):
            closed = ClosedChainFile.model_construct(kind="closed-chain", **keys)
            return closed_chain_of(description, closed, where, name, said=said, alone=True)
    serial = SerialFile.model_construct(kind="serial", **keys)
    return serial_of(description, serial, where, name, said=said)


def _from_file(
    path: Path, frame: str | None, locked: dict[str, float], ros: dict[str, Any]
) -> ElasticMechanism:
    from cartstiff.loading import build, build_closed
    from cartstiff.loading.schema import (
        ClosedChainFile,
        ParallelFile,
        PlatformFile,
        SerialFile,
        SpringsFile,
        located,
        read_mechanism_file,
    )

    file, lines = read_mechanism_file(path)
    where = one_line(str(path))
    name = file.name or path.stem
    try:
        file = build.with_frame(file, frame, where)
        if locked:
            if not isinstance(file, (SerialFile, ClosedChainFile)):
                raise InputError(f"kind {file.kind} has no joints to lock", where=where,
                                 expected="kind serial or closed-chain")  # fmt: skip
            file = file.model_copy(update={"locked": {**file.locked, **locked}})
        if ros:
            file = _with_ros(file, ros, where)
        if isinstance(file, SerialFile):
            return build.build_serial(file, path.parent, where, name)
        if isinstance(file, (PlatformFile, SpringsFile)):
            return build.build_platform(file, where, name)
        if isinstance(file, ParallelFile):
            return build_closed.build_parallel(file, path.parent, where, name)
        return build_closed.build_closed_chain(file, path.parent, where, name)
    except InputError as error:
        raise located(error, path, lines) from None


def _with_ros(file: Any, ros: dict[str, Any], where: str) -> Any:
    """A file whose robots get more xacro arguments, and more folders for packages."""
    if hasattr(file, "model"):
        keys = {"xacro": {**file.xacro, **ros.get("xacro", {})},
                "package_path": [*ros.get("package_path", ()), *file.package_path]}  # fmt: skip
        return file.model_copy(update=keys)
    if isinstance(file.legs, list):
        return file.model_copy(update={"legs": [_with_ros(leg, ros, where) for leg in file.legs]})
    raise InputError(f"kind {file.kind} has no robot description", where=where,
                     expected="no xacro arguments and no package path")  # fmt: skip
