"""Load elastic mechanisms from names, files and Pinocchio models."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cartstiff.core.arrays import (
    checked_number,
    checked_pose,
    checked_reach,
    checked_vector,
)
from cartstiff.core.checked_call import checked
from cartstiff.core.errors import (
    InputError,
    UnknownArgumentError,
    UnknownNameError,
    one_line,
)
from cartstiff.core.geometry import se3
from cartstiff.core.mechanisms.elastic import ElasticMechanism
from cartstiff.core.notes import Note
from cartstiff.core.units import checked_gravity
from cartstiff.files.catalogue import (
    bundled,
    bundled_files,
    example_robot,
    example_robots,
)
from cartstiff.files.identity import recorded

if TYPE_CHECKING:
    from cartstiff.files.yaml_file import Lines


class Setup(TypedDict, total=False):
    """What `load` takes beside the mechanism.

    Attributes
    ----------
    frame : str
        Frame of the body: a link or a site, instead of the file's.
    locked : mapping of str to float
        Positions (rad, m) of joints that do not move; for serial arms and closed chains.
    springs : str
        Published joint springs by name (see `cartstiff models`), such as
        "kuka-kr270/klimchik-2013"; your own table (.csv: joint, stiffness [N m/arcmin]);
        or "actuators": the kp of an MJCF file's position actuators.
    stiffness, rest : float, mapping of str to float, or array_like
        Stiffness and rest positions of the joint springs, as in
        `ElasticMechanism.with_springs`; they replace those of `springs`.
    tcp : array_like (3,), (6,) or (4, 4)
        Place of M in the frame. Position and, if wanted, roll, pitch, yaw about fixed
        axes; or, in Python, the pose.
    gravity : array_like (3,)
        Gravity in F [m/s^2], such as 0,0,-9.81, instead of the file's.
    payload : array_like (1,) or (4,)
        Mass on the body [kg], and its centre in M; added to that of the file. Without any
        gravity that of the earth is assumed, along -z of F, and a note says so.
    xacro_args : mapping of str to str
        Arguments of a xacro file, by name.
    package_path : sequence of str or Path
        Folders in or under which ROS packages are searched, before ROS_PACKAGE_PATH,
        AMENT_PREFIX_PATH and the folders above the file.
    parameters : mapping of str to float
        Values that replace those of the mechanism file's parameters, in its units.
    """

    frame: str | None
    locked: Mapping[str, float] | None
    springs: str | None
    stiffness: float | str | Mapping[str, float | str] | ArrayLike | None
    rest: float | Mapping[str, float] | ArrayLike | None
    tcp: ArrayLike | None
    gravity: ArrayLike | None
    payload: ArrayLike | None
    xacro_args: Mapping[str, str] | None
    package_path: str | Path | Sequence[str | Path]
    parameters: Mapping[str, float] | None


class ModelSetup(Setup, total=False):
    """What belongs to Pinocchio's models only.

    Attributes
    ----------
    q : array_like, shape (nq,)
        Default posture as a configuration of the model; default the wrapper's ``q0``, or
        a reference configuration of the model ("home", "half_sitting", ..., else the only
        one).
    closures : sequence of pinocchio.RigidConstraintModel
        Loops: ``CONTACT_3D`` ties two points, ``CONTACT_6D`` two frames.
    actuated : sequence of str
        Joints with motors, where there are closures.
    floating : bool
        Whether a free-flying root moves; by default it is held where `q` has it.
    name : str
        Name of the mechanism; default the model's.
    """

    q: ArrayLike | None
    closures: Sequence[Any]
    actuated: Sequence[str]
    floating: bool
    name: str | None


class FileKeys(TypedDict, total=False):
    """Keys that mechanism files of every kind share."""

    description: str
    source: str
    gravity: ArrayLike
    payload: Mapping[str, Any]
    parameters: Mapping[str, float | str]
    identified: Mapping[str, Any]
    units: Mapping[str, str]


class PlatformKeys(FileKeys, total=False):
    """Other keys of a file of kind stewart-gough."""

    name: str
    pose: Mapping[str, Any]
    frame: Mapping[str, Any]
    body: Mapping[str, Any]
    flexible: Mapping[str, Any]


class ParallelKeys(FileKeys, total=False):
    """Other keys of a file of kind parallel."""

    offset: Mapping[str, Any]
    actuated: Sequence[str]
    lines: Sequence[Mapping[str, Any]]


@checked
def load(
    source: Any, *, visual: Any = None, **setup: Unpack[ModelSetup]
) -> ElasticMechanism:
    """Load a mechanism.

    Parameters
    ----------
    source : str, Path, pinocchio.Model, pinocchio.RobotWrapper or tuple
        A bundled mechanism ("stewart-gough"), a mechanism file (.yaml), a URDF, xacro or
        MJCF file, XML text, or the name of a robot of example-robot-data ("panda") or of
        robot_descriptions ("ur5e_description"), looked up in this order; or an object of
        Pinocchio: a model, a wrapper, or a tuple (model, collision model, visual model).
    visual : pinocchio.GeometryModel, optional
        Shapes of the links of a Pinocchio model; default those of the wrapper or tuple.
    **setup
        Keywords of `Setup`: `frame`, `locked`, `springs`, `stiffness`, `rest`, `tcp`,
        `gravity`, `payload`, `xacro_args`, `package_path`, `parameters`; for Pinocchio's
        models those of `ModelSetup`: `q`, `closures`, `actuated`, `floating`, `name`.

    Returns
    -------
    ElasticMechanism
        Mechanism, springs, default posture, and notes on what was assumed.

    Raises
    ------
    InputError
        With what is wrong, where, what was expected and what was got.
    """
    given: Mapping[str, Any] = setup
    _check_words(given)
    get, tcp, payload = given.get, given.get("tcp"), given.get("payload")
    overrides = {
        "frame": get("frame"),
        "locked": _positions(get("locked")),
        "actuator_springs": get("springs") == "actuators",
        **tool_of(tcp, get("gravity"), payload),
    }
    if isinstance(source, (str, Path)):
        loaded = _from_words(source, visual, setup, overrides)
    else:
        loaded = _from_object(source, visual, setup, overrides)
    # What is hung on the body comes after the file's own, then springs by name, by value.
    if tcp is not None and np.size(tcp) == 6:
        from cartstiff.files.plausible import large_angles

        turn = np.asarray(tcp, float).ravel()[3:].tolist()
        loaded = loaded.with_notes(*large_angles({"the tool's rotation": turn}))
    if payload is not None:
        loaded = _carrying(loaded, overrides["payload"], get("gravity") is None)
    body = getattr(loaded.mechanism, "body", None)
    if body is not None:
        checked_reach(body.T_j_f[:3, 3], f"frame {loaded.mechanism.frame!r}")
    springs = get("springs")
    if springs not in (None, "actuators"):
        from cartstiff.files.published import with_named_springs

        loaded = with_named_springs(loaded, springs)
    return loaded.with_springs(get("stiffness"), get("rest"))


@checked
def from_pinocchio(
    model: Any, visual: Any = None, **setup: Unpack[ModelSetup]
) -> ElasticMechanism:
    """Build the elastic mechanism of a Pinocchio model, as `cartstiff.load` does.

    Joint stiffnesses are assumed, as for a URDF; give them with
    `ElasticMechanism.with_springs`.

    Parameters
    ----------
    model : pinocchio.Model, pinocchio.RobotWrapper or tuple
        A tuple is (model, collision model, visual model), as Pinocchio's loaders return
        it, or (model, visual model). Not changed.
    visual : pinocchio.GeometryModel, optional
        Shapes of the links; default those of the wrapper or the tuple.
    **setup
        `frame`, `q`, `locked`, `closures`, `actuated`, `floating`, `name`, `tcp`,
        `gravity` and others, see `ModelSetup`.

    Raises
    ------
    InputError
        For joints, constraints or arguments that cannot be used.
    UnknownNameError
        For a frame or joint that the model does not have.
    """
    from cartstiff.files.pinocchio_model import is_pinocchio

    if not is_pinocchio(model):
        raise InputError(
            "not a Pinocchio model",
            expected="pinocchio.Model, RobotWrapper or a tuple of models",
            got=type(model).__name__,
        )
    return load(model, visual=visual, **setup)


def _check_words(given: Mapping[str, Any]) -> None:
    """Refuse unknown keywords, and a frame that is no name."""
    known, frame = ModelSetup.__annotations__, given.get("frame")
    for name in given.keys() - known:
        raise UnknownArgumentError("argument of load", name, known)
    if frame is not None and not isinstance(frame, str):
        raise InputError("frame is not a name", expected="text", got=frame)


def _carrying(loaded: ElasticMechanism, payload: Any, falls: bool) -> ElasticMechanism:
    """Return a mechanism with a payload; without any gravity that of the earth acts."""
    from cartstiff.core.mechanisms.gravity_loads import with_default_gravity

    loaded = loaded.with_payload(*payload)
    return with_default_gravity(loaded, payload[0]) if falls else loaded


def _from_words(
    source: str | Path, visual: Any, setup: ModelSetup, overrides: dict[str, Any]
) -> ElasticMechanism:
    """Load what has a name, a path, or XML text."""
    of_model = setup.keys() - Setup.__annotations__.keys()
    if of_model or visual is not None:
        raise InputError(
            f"{min(of_model, default='visual')!r} belongs to Pinocchio's models only",
            where=one_line(str(source)),
            expected="frame, locked, stiffness, rest, tcp, gravity, payload",
        )
    ros = _ros_keys(setup.get("xacro_args"), setup.get("package_path", ()))
    overrides |= {"parameters": setup.get("parameters"), **ros}
    with recorded() as files:
        loaded = _from_name(source, overrides)
    return replace(loaded, files=tuple(files))


def _from_object(
    source: Any, visual: Any, setup: ModelSetup, overrides: dict[str, Any]
) -> ElasticMechanism:
    """Load an object of Pinocchio."""
    from cartstiff.files.pinocchio_model import is_pinocchio, of_pinocchio

    if any(map(setup.get, ("xacro_args", "package_path", "parameters"))):
        raise InputError(
            "xacro_args, package_path and parameters belong to files",
            got=type(source).__name__,
        )
    if not is_pinocchio(source):
        raise InputError(
            "mechanism is neither a name nor a path nor a Pinocchio model",
            expected="str, Path, pinocchio.Model, RobotWrapper or a tuple of models",
            got=type(source).__name__,
        )
    own: dict[str, Any] = {
        key: x for key, x in setup.items() if key not in Setup.__annotations__
    }
    return of_pinocchio(source, overrides, visual, **own)


def _positions(locked: Any) -> dict[str, float]:
    """Check the positions of locked joints."""
    named = dict(locked or {})
    return {
        name: checked_number(x, f"position of locked {name!r}")
        for name, x in named.items()
    }


def tool_of(tcp: Any, gravity: Any, payload: Any) -> dict[str, Any]:
    """Check tool, gravity and payload; return them as keys of overrides."""
    keys: dict[str, Any] = {}
    if tcp is not None:
        if np.shape(tcp) == (4, 4):
            keys["tcp"] = checked_pose(tcp, "tcp")
        else:
            numbers = _padded(tcp, 3, 6, "tcp")
            keys["tcp"] = se3.from_roll_pitch_yaw(numbers[:3], numbers[3:])
        checked_reach(keys["tcp"][:3, 3], "tcp")
    if gravity is not None:
        checked_gravity(gravity, where="gravity")
        keys["gravity"] = checked_vector(gravity, 3, "gravity").tolist()
    if payload is not None:
        mass, *centre = _padded(np.atleast_1d(payload), 1, 4, "payload")
        if mass < 0:
            raise InputError("mass is negative", where="payload", got=f"{mass:g}")
        checked_reach(np.array(centre), "payload")
        keys["payload"] = mass, tuple(centre)
    return keys


def _padded(value: Any, least: int, full: int, name: str) -> list[float]:
    """Check `least` or `full` numbers; the missing ones are zero."""
    numbers = checked_vector(value, least if np.size(value) == least else full, name)
    return [*numbers.tolist(), *[0.0] * (full - numbers.size)]


def _ros_keys(arguments: Any, folders: Any) -> dict[str, Any]:
    """Check xacro arguments and package folders.

    Return the keys of a mechanism file for them.
    """
    folders = [folders] if isinstance(folders, (str, Path)) else list(folders)
    keys: dict[str, Any] = {}
    if arguments:
        if not isinstance(arguments, Mapping):
            raise InputError(
                "xacro_args is not a mapping",
                expected="names and values",
                got=type(arguments).__name__,
            )
        # xacro writes truth values in lower case.
        words = {True: "true", False: "false"}
        keys["xacro"] = {
            str(k): words[v] if isinstance(v, bool) else str(v)
            for k, v in arguments.items()
        }
    for folder in folders:
        if not Path(str(folder)).expanduser().is_dir():
            raise InputError(
                "no such folder", where="--package-path", got=one_line(str(folder))
            )
    if folders:
        keys["package_path"] = [str(Path(f).expanduser().resolve()) for f in folders]
    return keys


def _from_name(source: str | Path, overrides: dict[str, Any]) -> ElasticMechanism:
    """Load a mechanism by its name or path, or from XML text."""
    from cartstiff.files.readers import robot_files
    from cartstiff.files.ros import is_description_name
    from cartstiff.files.yaml_file import read_yaml

    text = str(source)
    if isinstance(source, str) and text.lstrip().startswith("<"):
        return _from_robot(text, "robot", overrides)
    path = _path_of(text)
    suffix = path.suffix.lower()
    file = bundled(text) or (path if suffix in (".yaml", ".yml") else None)
    if file is not None:
        return from_data(*read_yaml(file), file, overrides)
    if suffix in robot_files():
        return _from_robot(str(path), path.stem.removesuffix(".urdf"), overrides)
    robots, exists = example_robots(), path.exists()
    if text in robots or (is_description_name(text) and not exists):
        return _from_robot(text, text, overrides)
    if exists:
        expected = ".yaml, .urdf, .xacro or MJCF .xml"
        if suffix == ".csv":
            expected += "; a DH table goes into a .yaml as 'dh: {table: ...}'"
        what = "is a directory" if path.is_dir() else "unknown kind of file"
        raise InputError(what, where=one_line(text), expected=expected)
    if not robots and text.isidentifier():
        # Its error says how to install the robots that may have this name.
        example_robot(text)
    also = " (see `cartstiff models`), or a file: .yaml, .urdf, .xacro, MJCF .xml"
    raise UnknownNameError("mechanism", text, [*bundled_files(), *robots], also=also)


def _path_of(text: str) -> Path:
    """Path of a text that the system can look for."""
    if not text.strip() or "\0" in text:
        raise InputError(
            "mechanism has no name", expected="a name or a path", got=repr(text)
        )
    try:
        path = Path(text).expanduser()
        path.exists()
    except (RuntimeError, OSError) as error:
        raise InputError(
            "not a usable path", where=one_line(text), got=str(error)
        ) from None
    return path


def _from_robot(model: str, name: str, overrides: dict[str, Any]) -> ElasticMechanism:
    from cartstiff.files.bare import Bare, places_in, with_overrides
    from cartstiff.files.passes import one_robot
    from cartstiff.files.readers import robot_of

    where = "XML text" if model.lstrip().startswith("<") else one_line(model)
    if parameters := overrides.get("parameters"):
        raise InputError(
            "parameters belong to mechanism files",
            where=where,
            expected="a .yaml file",
            got=", ".join(parameters),
        )
    alone = Bare(model=model)
    with places_in(where):
        serial = with_overrides(alone, overrides)
        robot, notes = robot_of(serial, None), list[Note]()
        if robot.gravity is not None and serial.gravity is None:
            gravity = robot.gravity.tolist()
            serial = serial.model_copy(update={"gravity": gravity})
            shown = ", ".join(f"{g:g}" for g in gravity)
            words = f"gravity ({shown}) m/s^2 acts, as the file says"
            notes.append(Note("gravity-of-file", words, {"gravity": gravity}))
        return one_robot(robot, serial, name, notes, alone=True)


def file_reader(
    source: str | Path,
) -> Callable[[dict[str, Any]], ElasticMechanism] | None:
    """Read a mechanism file once; return a function that builds its mechanism
    for overrides.

    None where the name is not that of a mechanism file.
    """
    from cartstiff.files.yaml_file import read_yaml

    path = bundled(str(source)) or Path(source).expanduser()
    if path.suffix.lower() not in (".yaml", ".yml"):
        return None
    with recorded() as own:
        data, lines = read_yaml(path)

    def mechanism(overrides: dict[str, Any]) -> ElasticMechanism:
        with recorded() as files:
            elastic = from_data(data, lines, path, overrides)
        if "payload" in overrides:
            elastic = elastic.with_payload(*overrides["payload"])
        return replace(elastic, files=(*own, *files))

    return mechanism


def from_data(
    data: dict[str, Any], lines: Lines, path: Path, overrides: dict[str, Any]
) -> ElasticMechanism:
    """Build the mechanism of a file's data with overrides."""
    from cartstiff.files.bare import place_of, places_in
    from cartstiff.files.mechanism_file import checked_file, mechanism_of

    file, parameters = checked_file(data, lines, path, overrides.get("parameters"))
    with places_in(one_line(str(path)), lambda at: place_of(path, lines, at)):
        return mechanism_of(file, parameters, path, overrides)


@checked
def hexapod(
    *,
    base: Mapping[str, Any] | None = None,
    platform: Mapping[str, Any] | None = None,
    height: float | None = None,
    turn: float | None = None,
    symmetry: int | None = None,
    cubic: Mapping[str, Any] | None = None,
    legs: float | Mapping[str, Any],
    **keys: Unpack[PlatformKeys],
) -> ElasticMechanism:
    """Build a Stewart-Gough platform from radii and angles, or in a cube.

    The arguments are the keys of a mechanism file of kind stewart-gough with a
    ``layout``, with the same meanings and checks.

    Parameters
    ----------
    base, platform : mapping
        The joints' circles: ``radius``, ``half_angle`` (rad) of the pairs or ``angles``
        (rad) of the joints, ``height``.
    height : float
        Height of the platform's frame P over F, a length; default 0 for a cube.
    turn : float, optional
        Turn [rad] of the platform's pairs against the base's; default pi/3.
    symmetry : {1, 2, 3, 6}, optional
        Number of equal parts; `angles` are those of one part.
    cubic : mapping, optional
        ``edge`` or ``size`` of a cube, and its ``centre``.
    legs : float or mapping
        The stiffness of every leg, or the file's key: ``stiffness`` or ``strut``,
        ``rest_length``, ``preload``, ``limits``, ``mass``, ``damping``.
    **keys
        Any other key of the file, see `PlatformKeys`: ``name`` for people, ``units``,
        ``pose``, ``frame``, ``body``, ``flexible``, ``payload``, ``gravity``.

    Returns
    -------
    ElasticMechanism
        The mechanism, as from `load`.

    Raises
    ------
    InputError
        With the key that cannot be used.

    Examples
    --------
    >>> import cartstiff
    >>> ring = {"radius": 0.3, "half_angle": 0.2}
    >>> platform = cartstiff.hexapod(base=ring, platform=ring, height=0.4, legs=1e6)
    >>> platform.mechanism.leg_lengths(platform.q).round(4).tolist()
    [0.4432, 0.4432, 0.4432, 0.4432, 0.4432, 0.4432]
    """
    numbers = {
        "base": base,
        "platform": platform,
        "height": height,
        "turn": turn,
        "symmetry": symmetry,
        "cubic": cubic,
    }
    layout = {key: plain(value) for key, value in numbers.items() if value is not None}
    data = {"name": "hexapod", "kind": "stewart-gough", "layout": layout}
    data |= plain(keys)
    data["legs"] = (
        plain(legs) if isinstance(legs, Mapping) else {"stiffness": plain(legs)}
    )
    return from_data(data, {}, Path("hexapod"), {})


@checked
def parallel(
    legs: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    pose: ArrayLike | None = None,
    *,
    name: str = "parallel",
    **keys: Unpack[ParallelKeys],
) -> ElasticMechanism:
    """Build a body carried by several legs, from the keys of a file of ``kind:
    parallel``.

    Parameters
    ----------
    legs : mapping or sequence of mappings
        Legs by name, such as ``{"chain": "PUS", "base": {"radius": 0.3, "half_angle":
        0.2}, ...}``, chains of a robot description, or a list of both.
    pose : array_like (4, 4) or (6,), optional
        ``T_F_P`` where the legs are put together: the pose, or x, y, z, roll, pitch, yaw
        about fixed axes (lengths, rad). Legs by name need it.
    name : str
        Name for people.
    **keys
        Any other key of the file, see `ParallelKeys`: ``units``, ``offset``,
        ``actuated``, ``lines``, ``payload``, ``gravity``, ``source``, ...

    Returns
    -------
    ElasticMechanism
        The mechanism, as from `cartstiff.load`.

    Raises
    ------
    InputError
        With the key that cannot be used.

    Examples
    --------
    >>> import cartstiff
    >>> legs = {
    ...     "chain": "PUS", "rail": "vertical", "rod": 0.5, "stiffness": 2e7,
    ...     "base": {"radius": 0.35, "half_angle": 0.2},
    ...     "platform": {"radius": 0.15, "half_angle": 0.2},
    ... }
    >>> machine = cartstiff.parallel(legs, [0, 0, 0.55, 0, 0, 0])
    >>> round(cartstiff.analyse(machine).K.matrix[5, 5])
    120000000
    """
    data = {"kind": "parallel", "name": name, "legs": plain(legs)}
    data |= {key: plain(value) for key, value in keys.items()}
    if pose is not None:
        numbers = _numbers(pose)
        data["pose"] = {"xyz": numbers[:3], "rpy": numbers[3:]}
    return from_data(data, {}, Path(name), {})


def _numbers(pose: ArrayLike) -> list[float]:
    if np.shape(pose) == (4, 4):
        T = checked_pose(pose, "pose")
        return [*T[:3, 3].tolist(), *se3.roll_pitch_yaw(T).tolist()]
    return list(checked_vector(pose, 6, "pose").tolist())


def plain(value: Any) -> Any:
    """Return values as a file holds them: mappings, lists and numbers."""
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return value.item() if isinstance(value, np.generic) else value
