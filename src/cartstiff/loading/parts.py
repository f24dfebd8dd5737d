"""Parts that every kind of mechanism is built from: trees, springs, lines, payloads, postures."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from cartstiff import numerics
from cartstiff.arrays import Array
from cartstiff.errors import InputError, UndefinedError, check_name, one_line
from cartstiff.geometry import se3
from cartstiff.loading.catalogue import example_robot
from cartstiff.loading.robot_description import (
    RobotDescription,
    described_text,
    read_robot_description,
)
from cartstiff.loading.robot_facts import Lifted, Obstacle, RobotFacts, to_root
from cartstiff.loading.ros import ROBOT_FILES, Ros, described_robot, is_description_name
from cartstiff.loading.schema import pose_of
from cartstiff.mechanisms.chain import Chain
from cartstiff.mechanisms.contract import rest_of_turns
from cartstiff.mechanisms.elastic import ElasticMechanism
from cartstiff.mechanisms.flexible_links import Give
from cartstiff.mechanisms.tree import KinematicTree
from cartstiff.mechanisms.tree_building import find_frame, plain_tree
from cartstiff.notes import Note, assumed_stiffness
from cartstiff.numerics import ZERO
from cartstiff.potentials.beams import Beam, Section
from cartstiff.potentials.contract import Potential
from cartstiff.potentials.line_springs import LineSprings, line_geometry
from cartstiff.potentials.loads import DeadForce
from cartstiff.potentials.springs import (
    CoupledSprings,
    JointSprings,
    PolynomialLaw,
    SpringLaw,
    TabulatedLaw,
)

if TYPE_CHECKING:
    from cartstiff.loading.schema import (
        BeamModel,
        ClosedChainFile,
        FlexibleModel,
        JointSpringModel,
        LegModel,
        LineModel,
        ParallelFile,
        PayloadModel,
        SerialFile,
    )


#: N m/rad (N/m) taken where nobody gave a joint stiffness; said in the notes.
ASSUMED_STIFFNESS = 1.0e4


def springs_of(
    springs: Mapping[str, JointSpringModel],
    passive: Sequence[str],
    tree: KinematicTree,
    facts: RobotFacts,
    where: str,
    *,
    virtual: Sequence[str] = (),
    actuated: Sequence[str] | None = None,
) -> tuple[JointSprings, list[Note]]:
    """Joint springs of a file's entries, and notes on what was assumed.

    A joint without an entry has the spring that the robot's own file gives it. Of the others those
    that are actuated get an assumed one: in a serial arm all but the `passive` ones, in a closed
    chain (`actuated` is a sequence) those that are named there, or all but the passive ones where
    only these are named. Joints without a spring are free, as virtual joints of links are.
    """
    names = [c.name for c in tree.coordinates]
    passive = [*passive, *(n for n in virtual if n not in passive)]
    driven = set(names) - set(passive) - set(facts.passive)
    if actuated is not None and (actuated or springs or not set(passive) - set(virtual)):
        driven &= set(actuated)
    for entries, key in ((springs, "springs"), (passive, "passive")):
        for name in entries:
            check_name("joint", name, names, f"{where}, key {key}")
    both = set(springs) & set(passive)
    if both:
        raise InputError(f"joint {min(both)!r} is passive and has a spring", where=where)
    stiffness, rest = np.zeros(len(names)), np.full(len(names), np.nan)
    laws: dict[int, SpringLaw] = {}
    assumed: list[str] = []
    unsprung: list[str] = []
    for j, name in enumerate(names):
        entry = springs.get(name)
        if entry is not None:
            if entry.rest is not None:
                rest[j] = entry.rest
            if entry.stiffness is not None:
                stiffness[j] = entry.stiffness
            elif entry.polynomial is not None:
                laws[j] = PolynomialLaw(tuple(entry.polynomial))
            elif entry.table is not None:
                x, y = np.array(entry.table).T
                laws[j] = TabulatedLaw(tuple(x.tolist()), tuple(y.tolist()))
            if stiffness[j] == 0.0 and j not in laws:
                rest[j] = 0.0 if entry.rest is None else entry.rest
        elif name in facts.springs and name not in passive:
            spring = facts.springs[name]
            rest[j] = spring.rest
            if len(spring.coefficients) > 1:
                laws[j] = PolynomialLaw(spring.coefficients)
            else:
                stiffness[j] = spring.coefficients[0]
        elif name in driven:
            if springs and actuated is None:
                raise InputError(
                    f"joint {name!r} has no spring",
                    where=where,
                    expected="an entry under springs, passive or locked",
                )
            stiffness[j] = ASSUMED_STIFFNESS
            assumed.append(name)
        else:
            rest[j] = 0.0
            if name in facts.passive and name not in passive:
                unsprung.append(name)
    notes = [assumed_stiffness(ASSUMED_STIFFNESS, assumed, names)] if assumed else []
    notes += rest_of_turns(tree.coordinates, rest)
    notes += softening({name: entry for name, entry in springs.items() if not entry.stiffness})
    if unsprung:
        words = f"joints without a spring in the file move freely: {', '.join(unsprung)}"
        notes.append(Note("passive-joints", words, {"joints": unsprung}))
    return JointSprings(stiffness, rest, laws), notes


def softening(springs: Mapping[str, JointSpringModel]) -> list[Note]:
    """Names springs of joints whose torque falls while they turn."""
    soft = []
    for name, entry in springs.items():
        if entry.table is not None:
            x, y = np.array(entry.table).T
            falls = bool(np.any(np.diff(y) < 0.0)) and bool(np.all(np.diff(x) > 0.0))
        else:
            falls = entry.polynomial is not None and entry.polynomial[0] < 0.0
        if falls:
            soft.append(name)
    return _negative(soft)


def _negative(names: Sequence[str]) -> list[Note]:
    if not names:
        return []
    words = f"springs whose stiffness is negative, at rest or farther: {', '.join(names)}"
    return [Note("negative-stiffness", words, {"springs": list(names)})]


def negative_links(springs: Sequence[Potential]) -> list[Note]:
    """Names links whose 6x6 spring has a motion along which it pushes on."""
    notes = []
    for spring in springs:
        if isinstance(spring, CoupledSprings):
            values = np.linalg.eigvalsh(spring.matrix)
            if values[0] < -ZERO * abs(values).max():
                notes.append(f"link {spring.link}")
    return _negative(notes)


def give_of(entry: FlexibleModel) -> Give:
    """Virtual joints of a flexible link."""
    start = pose_of(entry.offset)
    if entry.beam is None:
        return Give(start, mass=entry.mass)
    beam = entry.beam
    own = None
    if beam.density > 0.0:
        own = beam.density * beam.area, beam.density * beam.Iy, beam.density * beam.Iz
    return Give(start, beam.length, beam.segments, own)


def virtual_joints(flexible: Mapping[str, FlexibleModel], prefix: str = "") -> list[str]:
    """Names of the virtual joints of flexible links."""
    return [
        f"{prefix}{link}.{suffix}"
        for link, entry in flexible.items()
        for suffix, _, _ in give_of(entry).joints
    ]


def link_springs(
    flexible: Mapping[str, FlexibleModel], tree: KinematicTree, where: str, prefix: str = ""
) -> list[Potential]:
    """Springs over the virtual joints of flexible links, and beams."""
    names = [c.name for c in tree.coordinates]
    springs: list[Potential] = []
    for link, entry in flexible.items():
        indices = np.array([names.index(name) for name in virtual_joints({link: entry}, prefix)])
        if entry.beam is not None:
            springs.append(_beam(entry.beam, indices, prefix + link))
            continue
        K = np.array(entry.stiffness, float)
        if np.abs(K - K.T).max() > numerics.SYMMETRY * np.abs(K).max():
            raise InputError(
                "stiffness of a link must be symmetric", where=f"{where}, flexible {link}"
            )
        springs.append(CoupledSprings(indices, K[se3.SWAP][:, se3.SWAP], prefix + link))
    return springs


def _beam(beam: BeamModel, indices: Array, link: str) -> Beam:
    along_y, along_z = (
        np.inf if area is None else beam.G * area for area in (beam.shear_area_y, beam.shear_area_z)
    )
    section = Section(
        beam.E * beam.area,
        beam.G * beam.J,
        (beam.E * beam.Iy, beam.E * beam.Iz),
        (along_z, along_y),
    )
    mass = beam.density * beam.area * beam.length
    return Beam(indices, beam.length / beam.segments, section, link, mass)


def extra_lines(lines: Sequence[LineModel], mechanism: Chain, q: Array) -> list[LineSprings]:
    """Line springs and cables between points of named frames."""
    springs = []
    for line in lines:
        a, b = line.frames
        if mechanism.tree.placement(a).joint == mechanism.tree.placement(b).joint:
            raise InputError(
                "a line between two points of one link never changes its length",
                where="lines",
                got=f"{a!r} and {b!r}",
            )
        T, _ = mechanism.at(q).relative(a, b)
        ends = np.array([line.points[0]], float), np.array([line.points[1]], float)
        try:
            length = float(line_geometry(T, *ends).lengths[0])
        except UndefinedError:
            raise InputError(f"the line between {a!r} and {b!r} has zero length at q") from None
        rest = line.rest_length
        if rest is None:
            rest = length - (line.preload or 0.0) / line.stiffness
        springs.append(
            LineSprings(
                frame_a=a,
                frame_b=b,
                anchors=ends[0],
                points=ends[1],
                stiffness=np.array([line.stiffness]),
                rest_length=np.array([rest]),
                unilateral=line.unilateral,
            )
        )
    return springs


def described(
    file: SerialFile | LegModel | ClosedChainFile, beside: Path | None, floating: bool = False
) -> RobotDescription:
    """The robot of a `model:` entry: a path relative to the mechanism file, or a robot's name."""
    for folder in file.package_path:
        if not _from(beside, folder).is_dir():
            raise InputError("no such folder", where="package_path", got=one_line(folder))
    packages = tuple(_from(beside, p) for p in file.package_path)
    named = tuple(map(Path, file.named_folders))
    model, ros = file.model, Ros(packages, dict(file.xacro), named)
    if model.lstrip().startswith("<"):
        return described_text(model, floating, ros)
    path = _from(beside, model)
    if path.suffix.lower() not in ROBOT_FILES and not path.is_file():
        if is_description_name(model):
            path, more = described_robot(model)
            ros = Ros(
                (*ros.packages, *more.packages),
                {**more.arguments, **ros.arguments},
                (*named, *more.packages),
            )
        else:
            path = example_robot(model)
    return read_robot_description(path, floating, ros)


def _from(beside: Path | None, name: str) -> Path:
    path = Path(name).expanduser()
    return path if beside is None or path.is_absolute() else beside / path


def add_payload(tree: KinematicTree, chain: Chain, payload: PayloadModel | None) -> None:
    """Hang a point mass on the body frame."""
    if payload is not None and payload.mass > 0 and chain.body.joint > 0:
        centre = chain.body.T_j_f @ np.append(payload.com, 1.0)
        chain.payload = payload.mass, float(tree.model.inertias[chain.body.joint].mass)
        inertia = pin.Inertia(payload.mass, centre[:3], np.zeros((3, 3)))
        tree.model.appendBodyToJoint(chain.body.joint, inertia, pin.SE3.Identity())


def put_together(
    file: SerialFile | ParallelFile | ClosedChainFile,
    name: str,
    chain: Chain,
    q: Array,
    springs: JointSprings,
    soft: Sequence[Potential],
    notes: Sequence[Note],
    where: str,
    lifted: Sequence[Lifted] = (),
    entries: Mapping[str, JointSpringModel] | None = None,
) -> ElasticMechanism:
    """A chain with its springs, soft links, and what else the file puts on it."""
    notes = [*notes, *beams_that_end_elsewhere(soft, chain), *negative_links(soft)]
    notes += _idle_links(soft, chain, file.lines)
    elastic = ElasticMechanism(name, chain, q, springs, notes=tuple(notes))
    elastic = elastic.with_gravity(file.gravity, where=f"{where}, key gravity")
    chain.undriven = frozenset(np.flatnonzero(springs.is_passive).tolist()) - springs.rigid
    potentials = [*soft, *extra_lines(file.lines, chain, q)]
    if not potentials and len(chain.undriven) == chain.tree.n:
        names = ", ".join(chain.names)
        words = (
            f"no joint has a spring, and none is named as actuated, so all move freely: {names}. "
            "Which are actuated? Give --stiffness joint=value, or 'actuated' or 'springs' in the "
            "mechanism file"
        )
        elastic = elastic.with_notes(Note("springs-missing", words, {"joints": list(chain.names)}))
    if elastic.gravity is not None:
        potentials += [
            DeadForce(-part.mass * elastic.gravity, part.point, part.body)
            for part in lifted
            if chain.tree.placement(part.body).joint > 0
        ]
    joint_springs = entries or {}
    M, damping = chain.tree.mimic, np.array(chain.tree.model.damping, float).reshape(-1)
    if M is not None:
        damping = np.asarray((M * M).T @ damping)  # followers turn by their factor
    for i, n in enumerate(chain.names):
        if n in joint_springs and joint_springs[n].damping is not None:
            damping[i] = joint_springs[n].damping
    elastic = replace(elastic, damping=damping if damping.any() else None)
    return elastic.with_potential(*potentials)


def _idle_links(soft: Sequence[Potential], chain: Chain, lines: Sequence[LineModel]) -> list[Note]:
    """Names links that give and carry neither the body nor anything that holds it."""
    frames = [f for line in lines for f in line.frames]
    frames += [f for closure in chain.closures for f in (closure.frame_a, closure.frame_b)]
    model, tree = chain.tree.model, chain.tree
    ends = {chain.body.joint, *(tree.placement(f).joint for f in frames)}
    felt = {model.names[int(j)] for end in ends for j in model.supports[end] if j}
    idle = [
        spring.link
        for spring in soft
        if isinstance(spring, (Beam, CoupledSprings))
        and felt.isdisjoint(tree.coordinates[i].name for i in np.ravel(spring.indices))
    ]
    if not idle:
        return []
    words = (
        f"links that give and do not move frame {chain.frame!r}: {', '.join(idle)} (what hangs on "
        "such a link gives, its own frame stands before its spring)"
    )
    return [Note("idle-link", words, {"links": idle})]


# Limits of a joint [rad] that look like degrees; larger ones stand for "none".
_DEGREES = (40.0, 1000.0)
# What is this near to the end of a beam, over its length, is there.
_THERE = numerics.NEARBY


def beams_that_end_elsewhere(soft: Sequence[Potential], chain: Chain) -> list[Note]:
    """Beams at whose far end nothing hangs: perhaps their link does not lie along its x axis."""
    model, notes = chain.tree.model, []
    for beam in soft:
        if not isinstance(beam, Beam):
            continue
        frames = chain.tree.frames
        last = list(model.idx_vs).index(int(beam.indices[-1, -1]))
        hung = [
            model.jointPlacements[j].translation
            for j in range(model.njoints)
            if j and model.parents[j] == last
        ]
        hung += [place.T_j_f[:3, 3] for place in frames.values() if place.joint == last]
        length = beam.length * len(beam.indices)
        if not hung or min(np.linalg.norm(x) for x in hung) <= _THERE * length:
            continue
        nearest = min(hung, key=np.linalg.norm)
        x, y, z = nearest + np.array([length, 0.0, 0.0])
        notes.append(
            Note(
                "beam-elsewhere",
                f"the beam of link {beam.link!r} runs along the x axis of the link or its offset, "
                f"to ({length:.6g}, 0, 0); what hangs on it begins at ({x:.6g}, {y:.6g}, {z:.6g}), "
                "joined rigidly",
                {"link": beam.link, "length": length, "begins": [float(x), float(y), float(z)]},
            )
        )
    return notes


def joints_that_move(description: RobotDescription, frame: str) -> set[str]:
    """Joints on the way to a frame, and those that closures and couplings tie to them."""
    model, facts = description.model, description.facts
    names = list(model.names)
    joint = int(find_frame(model, frame).parentJoint)
    moving = {names[int(j)] for j in model.supports[joint]} - {names[0]}
    groups = [closure.joints for closure in facts.closures]
    groups += [frozenset({follower, rule[0]}) for follower, rule in facts.followers.items()]
    while any(group & moving and not group <= moving for group in groups):
        for group in groups:
            if group & moving:
                moving |= group
    return moving


def description_notes(
    description: RobotDescription,
    tree: KinematicTree,
    keys: Collection[str],
    closed: bool = False,
) -> list[Note]:
    """What a file says that plays no part, and where its posture and masses come from.

    Parameters
    ----------
    description : RobotDescription
        The robot as its file says.
    tree : KinematicTree
        The joints that were kept of it.
    keys : collection of str
        Keys that the mechanism file gives.
    closed : bool
        Whether the closures of the robot's file are kept.

    Raises
    ------
    InputError
        If something that cannot be expressed acts on a joint of the tree, or is wrong with it.
    """
    facts = description.facts
    notes = [*facts.notes]
    # A joint with several coordinates has become several: joint.x, joint.y, ...
    moving = {part for name in tree.model.names for part in (name, name.rpartition(".")[0])}
    obstacles = list(facts.obstacles)
    for tie in facts.closures:
        if not (closed and tie.joints & moving):
            words = f"the {tie.type} tie of bodies {tie.body_a!r} and {tie.body_b!r}"
            obstacles.append(Obstacle(words, tie.joints))
    for obstacle in obstacles:
        felt = sorted(obstacle.joints & moving)
        if not felt or not set(keys).isdisjoint(obstacle.keys):
            continue
        if obstacle.error is not None:
            raise obstacle.error
        raise InputError(
            f"{obstacle.what} acts on joint {felt[0]!r} and cannot be expressed here",
            where="XML text" if description.path is None else one_line(str(description.path)),
            expected=obstacle.expected,
        )
    ignored = [*facts.ignored, *(o.what for o in obstacles)]
    if ignored:
        words = "; ".join(ignored)
        notes.append(Note("ignored", f"parts of the robot's file play no part: {words}"))
    if facts.keyframe is not None:
        words = f"the default posture is keyframe {facts.keyframe!r} of the MJCF file"
        notes.append(Note("keyframe", words))
    if facts.weightless:
        words = "; ".join(facts.weightless)
        notes.append(Note("masses-unknown", f"taken as zero, since it is not known: {words}"))
    wide = {
        c.name: [c.lower, c.upper]
        for c in tree.coordinates
        if not c.is_length and _DEGREES[0] < max(-c.lower, c.upper) < _DEGREES[1]
    }
    if wide:
        words = ", ".join(f"{name} {low:g} ... {high:g}" for name, (low, high) in wide.items())
        message = f"limits of several turns: {words} rad. Degrees? Limits in URDF are in radians"
        notes.append(Note("limits-of-turns", message, wide))
    return notes


def gravity_left_out(
    file: SerialFile | ClosedChainFile, description: RobotDescription
) -> list[Note]:
    """That a mechanism file, which says itself what acts, leaves an MJCF file's gravity out."""
    gravity = description.facts.gravity
    if gravity is None or file.gravity is not None:
        return []
    shown = ", ".join(f"{g:g}" for g in gravity)
    words = f"the mechanism file names no gravity: that of the MJCF file ({shown}) is left out"
    return [Note("gravity-left-out", words, {"gravity": gravity.tolist()})]


def joint_indices(model: Any, names: Mapping[str, float], where: str) -> dict[int, float]:
    """Pinocchio's indices of named joints."""
    known = list(model.names)[1:]
    indices = {}
    for name, value in names.items():
        check_name("joint", name, known, where)
        indices[known.index(name) + 1] = value
    return indices


def tree_to(
    description: RobotDescription,
    frames: Sequence[str] | None,
    locked: Mapping[str, float],
    where: str,
    notes: list[Note],
    flexible: Mapping[str, FlexibleModel] | None = None,
    joints: Collection[str] = (),
) -> KinematicTree:
    """Plain tree of the joints that move some frames (all joints if None), mimics resolved.

    The named `joints` are kept as well.
    """
    model, facts = description.model, description.facts
    fixed = joint_indices(model, facts.locked | dict(locked), f"{where}, key locked")
    if frames is None:
        keep = set(range(1, model.njoints))
    else:
        keep = {j for j, name in enumerate(model.names) if j and name in joints}
        for name in frames:
            frame = find_frame(model, name)
            keep |= {int(j) for j in model.supports[int(frame.parentJoint)]} - {0}
    names = list(model.names)
    keep -= {names.index(name) for name in description.held}
    follows = {}
    for follower in facts.followers:
        index = names.index(follower) if follower in names else 0
        leader, factor, offset = to_root(follower, facts.followers)
        if index not in keep or index in fixed:
            continue
        if leader not in names:
            notes.append(
                Note(
                    "mimic-ignored",
                    f"joint {follower!r} mimics {leader!r}, which does not exist: it is taken as a "
                    "joint of its own",
                )
            )
            continue
        follows[follower] = (leader, factor, offset)
        keep.add(names.index(leader))
    for follower, (leader, factor, offset) in list(follows.items()):
        index = names.index(leader)
        if index in fixed:  # a locked leader locks its followers
            fixed[names.index(follower)] = factor * fixed[index] + offset
            del follows[follower]
    # Joints off the way stand where the file's posture has them: their masses are carried.
    for index, joint in enumerate(names):
        if index not in keep and joint in facts.posture:
            fixed.setdefault(index, facts.posture[joint])
    soft = {name: give_of(entry) for name, entry in (flexible or {}).items()}
    tree = plain_tree(model, keep, fixed, soft, facts.planar_axes)
    if not follows:
        return tree
    all_names = [c.name for c in tree.coordinates]
    free = [c for c in tree.coordinates if c.name not in follows]
    matrix, offsets = np.zeros((len(all_names), len(free))), np.zeros(len(all_names))
    for i, name in enumerate(all_names):
        leader, factor, offset = follows.get(name, (name, 1.0, 0.0))
        matrix[i, [c.name for c in free].index(leader)] = factor
        offsets[i] = offset
    if tree.mimic is not None:
        matrix, offsets = tree.mimic @ matrix, tree.mimic @ offsets
    return KinematicTree(tree.model, tuple(free), tree.given_frames, matrix, offsets)
