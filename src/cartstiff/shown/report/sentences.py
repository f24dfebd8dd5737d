"""The words of an answer: one table of sentences, for text, HTML,
the page and its script.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from string import Formatter
from typing import Any

from cartstiff.answer.data import (
    Answer,
    Displacement,
    Extreme,
    Frame,
    Quantity,
    Shares,
    Statement,
    Vector,
    wrench_parts,
)
from cartstiff.answer.verdict import ASYMMETRIC, NOT_TANGENT, Verdict
from cartstiff.core import numerics
from cartstiff.core.errors import listed
from cartstiff.core.stiffness.applied_load import LoadKind
from cartstiff.core.units import Units, engineering, shown_unit
from cartstiff.shown.report import layout

#: What a verdict's code says.
VERDICTS: dict[str, str] = {
    "positive": "Positive definite: every small motion is resisted",
    "positive semidefinite": "Positive semidefinite: some motion costs nothing",
    "indefinite": "Not stable: along some motion the body is pushed further away",
    "negative semidefinite": "Not stable: no motion is resisted",
    "negative": "Not stable: every motion is pushed further away",
    "zero": "Zero stiffness: no motion is resisted",
    "unresolved": "Digits are lost: whether every motion is resisted is not known",
    "no-stiffness": "The matrix does not exist here",
    "kf-undefined": "No K^F: six coordinates are no chart here",
    "constraint-singularity": "Constraint singularity: branches of motion cross here",
    "non-regular-redundancy": "The closures lose rank and block the motion",
    "unbalanced": "Unbalanced: the arm would move by itself, no wrench holds it",
    "buckled": "Buckled: the energy has no minimum along the self-motion",
    "strut-buckled": "A strut has buckled between its flexures",
    "strut-not-found": "The flexures are bent too far: no balance of a strut was found",
    "serial-singularity": "Singular posture: a motion of the end-effector is impossible",
    "idle-self-motion": "A self-motion costs no energy, yet moves the end-effector",
    "actuators-adjusted": "The loops do not close there: drives have moved",
    "fewer-than-six-freedoms": "Fewer than six free motions: only the compliance exists",
    "type-2-singularity": "Singular posture: the actuators do not hold the body",
    "near-constraint-singularity": "The closures nearly repeat each other",
    "singular-stiffness": "Singular stiffness: one motion costs nothing",
    "near-serial-singularity": "Near a singularity: one motion is almost impossible",
    "near-type-2-singularity": "Near a singularity: the drives resist some motion only "
    "weakly",
    "slack": "Slack cables carry nothing",
    "stable": "The equilibrium is stable",
    "unstable": "The equilibrium is NOT stable: the load pushes the body away",
    "undecided": "Whether the equilibrium is stable is not decided by definiteness: see "
    "the notes",
}
_NO_STABILITY = {
    NOT_TANGENT: "it is not the tangent under this load and decides no stability",
    ASYMMETRIC: "along some motion the load pushes further away; as it has no potential, "
    "this "
    "decides no stability",
}
VERDICTS |= {
    f"{fact} {kind}": f"{kind.capitalize()}: {why}"
    for fact, why in _NO_STABILITY.items()
    for kind in ("indefinite", "negative semidefinite", "negative", "zero")
}

_AWAY = "Turn a joint, choose Home, or look at the compliance, which exists here."
_ALONE = "Choose the load none to see what the springs do alone."
#: What to try where a verdict is not good, by its code; with "preload " before it, where
#: springs of the file need a wrench that nobody has given.
ADVICE: dict[str, str] = {
    "serial-singularity": "In this posture the joints cannot move the body along one "
    f"direction. {_AWAY}",
    "near-serial-singularity": "Turn a joint away from here: near a singularity one "
    "direction is very stiff, and its joints must move far.",
    "type-2-singularity": "The drives cannot hold the body here, whatever they do. "
    "Choose Home, or drag the body away.",
    "near-type-2-singularity": "Drag the body away from the singularity, or choose Home.",
    "constraint-singularity": "Several motions cross here. Choose Home, or move a drive.",
    "non-regular-redundancy": "Move a drive, so that the closures become regular.",
    "unbalanced": "Give a load, or choose Home: rest positions are then chosen so that "
    "the springs balance.",
    "buckled": "Reduce the load, or stiffen a spring.",
    "strut-buckled": "Reduce the load.",
    "strut-not-found": "Reduce the load, or move the body back.",
    "idle-self-motion": "Give every joint a spring.",
    "fewer-than-six-freedoms": "Look at the compliance: it says how the body moves along "
    "the directions that it has.",
    "slack": "Some cables are slack: a load that pulls on them tightens them.",
    "singular-stiffness": "Give every joint a spring, or read the compliance.",
    "indefinite": "Reduce the load: it pushes the body away along some motion.",
    "zero": "Give the joints springs.",
}
_UNSTABLE_LOAD = (
    "The springs of the file are stretched: only a wrench holds the body here, and along "
    f"some motion it pushes the body further away. {_ALONE}"
)
ADVICE |= {
    f"preload {fact}{kind}": _UNSTABLE_LOAD
    for fact in ("", *(f"{fact} " for fact in _NO_STABILITY))
    for kind in ("indefinite", "negative semidefinite", "negative", "zero")
}

#: Advice for springs that push along a self-motion without a given load.
BALANCING = (
    "--load 0,0,0,0,0,0 (or what acts) chooses rest positions at which the "
    "springs balance"
)

#: Sentences of statements by their code; "{length:4}" is a value with four digits, see
#: `value_words`. Those that begin with a line's place belong below a table.
SENTENCES: dict[str, str] = {
    "mechanism": "{subject}: {kind}, {body_frame}",
    "load": "Load: {load.kind}, {wrench:6} along the axes of the room, at {at:6} of the "
    "body; {load.words}",
    "most-loaded": "Most loaded: {name}, {force:4e}, {used:e} of its limit",
    "largest-forces": "Largest {each}; no limit of a drive's force is known",
    "force-of": "{force:4e} in {name}",
    # a posture
    "pose": "M at {place:6} in F, roll, pitch, yaw {turned:6}",
    "holding": "No load is given: {wrench:6} along the axes of the room must hold the "
    "body here",
    "holding-besides": "Besides the loads {wrench:6} along the axes of the room must "
    "hold the body here",
    "nothing-to-hold": "No load is given; no wrench is needed to hold the body here",
    "partly-known": "What the structure carries is not known, and is taken as zero",
    "stored-energy": "  energy stored in the springs {energy:6}",
    "potential": "  potential of gravity and loads {energy:6}",
    "rows-left-out": "  {count} more without spring, limits and share",
    # the analysis of a posture
    "the-compliance": "the compliance",
    "the-matrix": "K^{name}, {sign}",
    "its-symmetric-part": "the symmetric part of K^{name}, {sign}",
    "at-the-frame": "the body frame",
    "at-a-point": "the point {point} of the body frame",
    "in-other-axes": "the point {point} of the body frame, in other axes",
    "tangent-under": "  the tangent under a {kind} load at {at} of the body: {meaning}",
    "no-tangent-under": "  NOT the tangent (that is K^load) under a {kind} load at {at} "
    "of the body: {meaning}",
    "free-of-asymmetric": '  "free" comes from the symmetric part of its inverse: motion '
    "along a force",
    "characteristic-length": "  characteristic length {length} ({reason})",
    "from-the-origin": "the origin of the body frame",
    "from-the-point": "this point",
    "coupling": "  coupling of rotation and translation: {here:3} here, {there:3} at the "
    "point of least coupling (0 none, 1 full)",
    "coupling-without-bound": "  coupling of rotation and translation: {here:3} here, "
    "{there:3} at the point of least coupling (0 none; not bounded, as the matrix is "
    "indefinite)",
    "few-screws": "  only {count} real, independent eigenscrews",
    "complex-eigenvalue": "  complex eigenvalue {real} + {imaginary}i",
    "grows": "unstable, growing by {rate} /s",
    "difference": "{size:3} ({share:%})",
    "asymmetry": "  asymmetry of K^A: {size:%}, as the load predicts (residual "
    "{residual:2})",
    "asymmetry-unexplained": "  asymmetry of K^A: {size:%}, NOT as the load predicts "
    "(residual {residual:2})",
    "point-moves": "  the point {point} moves {size:5e}: {moves:4}",
    "body-turns": "  the body turns {turns:4} (all in the body's axes), energy {energy}",
    "share-of-load": "  the rest, {share:%}, is what the load and other potentials take "
    "or give",
    "left-open": "  * redundant closures between rigid links leave these open",
    "antisymmetric-by-load": "  the load adds an antisymmetric part to K^{name}, "
    "whatever springs",
    "springs-give-it": "  independent springs give it exactly",
    "coupled": "  joints must be coupled, up to {share:%}",
    "coupled-actively": "  joints must be coupled, up to {share:%}; not positive "
    "definite: active control",
    "springs-miss-it": "  independent springs miss it by {share:%} at best (angles times "
    "{length})",
    "unstable-target": "  the posture is not stable with it: the target is not positive "
    "definite",
    "order-from": " ({order} by {order_from})",
    "measured-springs": "the measured springs",
    "tolerance-of-stiffness": "stiffness {size:%}",
    "tolerance-of-length": "lengths {size}",
    "tolerance-of-angle": "rotations {size}",
    "principal-values-meet": "  principal values meet here: to first order their spread "
    "is rough",
    "main-parameter": "  most of the softest direction's variance: {name} ({share:%})",
    # a report
    "carries": "The mechanism carries {what:a}. It is {how}",
    "a-force": "a force of {size:4e}, {where}",
    "a-moment": "a moment of {size:4e}, {where}",
    "its-weight": "its weight",
    "nothing": "no load",
    "held-by-joints": "held by the springs of its joints",
    "held-by-legs": "held by the springs of its legs",
    "held-by-wrench": "held by the wrench named below",
    "not-held": "not held at this posture",
    "nothing-acts": "Load: none",
    "held-before": "At this posture, before any load, the springs are held by {wrench:6} "
    "along the axes of the room; stiffness and shares are those at this posture, before "
    "the load",
    "near-singular": "{kind}: {ratio:3}, the smallest over the largest singular value, "
    "lengths in {length:4e}",
    # a better posture
    "none-better": "No better posture was found: with the tip where it is, none moves "
    "{gain:e} less",
    "better": "Better posture (the tip stays where it is{turned}): {gain:e} less "
    "displacement, {there:4e} instead of {here:4e} (by the equilibrium){moved}",
    "tool-turns": ", the tool turns by {turn:3} about its z axis",
    "moves-most": "; {name} moves most, by {far:4e}",
    "other-configuration": "It is another configuration of the arm",
    "better-at": "It is at {places:4e}",
    "worse": "Worse there: {worse}",
    "nothing-worse": "Nothing else gets worse",
    "worse-margin": "{of} is {there:4e} from its limit ({here:4e} here)",
    "worse-stiffness": "the softest direction has {there:4e} ({here:4e} here)",
    "worse-condition": "the condition number is {there:4e} ({here:4e} here)",
    "worse-rotation": "the body turns by {there:4e} ({here:4e} here)",
    "by-quotients": "The search followed difference quotients: {reason}",
    "not-checked": "Collisions and the floor were not checked",
    # an equilibrium
    "no-load": "No load is given, and no wrench holds the body",
    "loads-included": "The loads are included in the stiffness; no other wrench holds "
    "the body",
    "rest": "It was found after {steps} step(s) with a relative residual of {residual:2}",
    "smallest-eigenvalue": "The smallest eigenvalue of the energy's Hessian is {value:6}",
    "nothing-moves": "Nothing can move",
    "lowest-undamped": "The lowest undamped frequency is {frequency:6}",
    "undamped-growth": "Undamped vibrations grow (see the notes)",
    "negative-determinant": "The determinant of the tangent is negative (see the notes)",
    "not-examined": "Flutter and divergence are not examined: motions without mass are "
    "left",
    "no-rest-before": "  without the load no rest was found: its own part is not known",
    "capacity": "Holds {factor:3} times this load (by the equilibrium), until {limit}",
    "capacity-differs": "Holds {factor:3} times this load (by the equilibrium; "
    "{linear:3} to first order), until {limit}",
    "capacity-linear": "Holds {factor:3} times this load (to first order), until {limit}",
    "greatest-payload": "In place of the load the drives hold {payload:4} kg at the "
    "body frame, to first order",
    "limit-force": "{names} is at its limit",
    "limit-slack": "{names} is slack",
    "limit-travel": "{names} is at the end of its travel",
    "limit-buckling": "the equilibrium is lost",
    "limit-displacement": "the allowed displacement is reached",
    # assemble
    "held": "Held: {held:6}",
    "modes": "Assembly modes: {count}; searched: {search}",
    "nearest-mode": "The nearest one is listed (--all: every one)",
    "all-modes": "No isolated mode is missing: every path's end is known",
    "modes-may-be-missing": "There may be more",
    "no-assembly": "No assembly mode exists",
    "least-stiffness": "min K: smallest eigenvalue of the tangent stiffness, angles "
    "times the body's length",
    "determinant": "det: of the legs' lines, moments over that length",
    # identify
    "fit": "{subject}, {body_frame}: {rows} rows, {numbers} numbers; {fit} fit "
    "(recommended) of {model}",
    "fit-not-recommended": "{subject}, {body_frame}: {rows} rows, {numbers} numbers; "
    "{fit} fit (the {recommended} one is recommended) of {model}",
    "springs-found": "All {all} stiffnesses are determined",
    "springs-undetermined": "{known} of {all} stiffnesses are determined",
    "singular-values": "Singular values of the scaled regressor: {largest:3} to "
    "{least:3}",
    "not-seen": "  not seen: {parts:2}",
    "plan": "{subject}: {rows} rows chosen for {criterion}",
    "not-loaded": "No candidate row loads {names}",
    "widest": "The widest interval with {rows} rows: {half} of the compliance",
    "half-width": "+- {half:3} %",
    "all-not-determined": "not all are determined",
    # curves and paths
    "curve": "Load-deflection curve of {subject}: {count} equilibria, ended: {reason}",
    "critical-load": "Critical load: {what:6}",
    "at-factor": "{kind} at factor {factor:10}",
    "times": "{count} modes",
    "unstable-from": "Unstable at factor {factor}; where it becomes so was not found",
    "no-critical-load": "No critical load up to the end of the curve",
    "no-limit-point": "No limit point and no branch up to the end of the curve; flutter "
    "is not examined",
    "linear-range": "The linear prediction stays within 5 % up to factor {translation:4} "
    "for the translation, {rotation:4} for the rotation",
    "compensation": "Deflection compensation of {subject} along {count} postures",
    "weight-against-all": "The weight is compensated as well (--against all)",
    "weight-against-load": "The weight is not compensated: the program was taught under "
    "it (--against load)",
    "axes-of-loads": "{what} along the {axes}",
    "compensated": "The largest error of the position is {after:6}, {before:6} without "
    "compensation",
    "from-springs": "{level} % from the measured springs, at most, along an axis: "
    "{moved:3}, {turned:3}",
    "commands-in-file": "(-o FILE.csv writes the commands.)",
    "path": "{subject}, {body_frame}: {points} points, {candidates} postures compared",
    "criterion": "{what}, {better} is better; K^{connection} {under}",
    "unloaded": "unloaded",
    "under-path-load": "under the path's load, {load.kind} at ({load.at}): {load.words}",
    "length-of-angles": "angles count by the characteristic length {length}",
    "free": "free: {what}",
    "turn-about": "rotation about the body's {axis} axis",
    "every-turn": "all of the body's rotation",
    "sampled-joint": "a self-motion of the joints, sampled by {joint}",
    "only-branch": "only the branch of the inverse kinematics",
    "worst-point": "worst at point {point}; smallest over largest singular value at "
    "least {ratio:3}",
    "no-limits": "no limits are known",
    "nearest-limit": "nearest to a limit: {name} at point {point}, {distance:4} from it, "
    "at {value:4}",
    "least-margin": "drives: {name} leaves least of its limit at point {point}, a share "
    "of {margin:3}",
    "as-said": "{words}",
    "no-constant-choice": "  no constant choice follows the path",
    "more-points": "  ... and {count} more points (-o FILE.csv has all)",
    # map
    "map": "{subject}: {count} postures, {body_frame}, K^{connection}, characteristic "
    "length {length:6}",
    "parts": "{file}: {total} part(s), {found} found there, {computed} computed",
    "slice": "  only the nearest places to the slice: {places}",
    "branches": "at most {found} branches found at a place, up to {kept} kept; searched "
    "from {starts} starts: the mechanism as a whole",
    "branches-of-legs": "at most {found} branches found at a place, up to {kept} kept; "
    "searched from {starts} starts: each of {legs} legs",
    "map-load": "K^load: the tangent under the load, {load.kind} at ({load.at}): "
    "{load.words}",
    "postures": "States of the {count} postures: {states}",
    "range": "{name} from {smallest:4e} to {largest:4e}",
    "balancing": f"unbalanced: {BALANCING}",
    "map-differs": "The map is of {what} than this report",
    "made-by": "Made by {command}",
    # compare
    "compared": "{second} compared with {first}",
    "one": "  {label}: {kind}, {of}, at {place:4} of the room",
    "frames-apart": "  body frames {distance} apart",
    "same-load": "  load: {load:4}, along the axes of the room",
    "load-of": "  load of {label}: {load:4}, along the axes of the room",
    "verdict-of": "{label}: {verdict}",
    "moves-by-first order": "Under the load {second} moves {ratio:3} times as far as "
    "{first} (to first order): {there:4e}, not {here:4e}",
    "moves-by-equilibrium": "Under the load {second} moves {ratio:3} times as far as "
    "{first} (by the equilibria): {there:4e}, not {here:4e}",
    "shares-of": "{label}: {shares}",
    "times-as-stiff": "Along its softest direction (free to turn) {second} is {ratio:3} "
    "times as stiff: {there:4e}, not {here:4e}",
    "directions-apart": "The softest directions are {angle:3} apart in the room",
    "no-ratio-both": "{names}: does not exist with either",
    "no-ratio-sign": "{names}: is zero or negative",
    "no-ratio-first": "{names}: does not exist with {first}",
    "no-ratio-second": "{names}: does not exist with {second}",
    # modes
    "swinging": "{subject}: {kind}, {body_frame}, small undamped motions about rest, "
    "{load}",
    "moving-masses": "Masses that move [kg]: {masses:4}",
    "lowest-frequency": "The lowest frequency is {frequency:6}, that of mode {mode}",
    "unstable-modes": "{count} of {all} modes are unstable: the motion grows",
    "free-modes": "{count} of {all} modes are free: no stiffness resists the motion",
    "mode-still": "does not move",
    "mode-slides": "moves along {direction:3}",
    "mode-turns": "about {direction:3} through {point:3}, pitch {pitch:3}",
    "more-parameters": "  {count} more, which matter less, with --json",
    "left-out": "  {names}",
    "noted": "  {note}",
    "closed-loop": "  closed loop without damping: {frequencies:6} Hz",
    "square-roots": "  by square roots instead the ratios are {ratios:3}, and "
    "{coupling:%} couples them",
    "joint-gains": "  joints: J^T K J and J^T D J, {count}x{count}, in --json and -o; "
    "gains of single joints, the diagonal, leave out {left_out:%}",
    "null-motion": "  null motion {motion:2} of the joints: no stiffness, no damping; "
    "with a stiffness k of its own 2 ratio sqrt({mass:3} k) damps it",
    "antisymmetric-part": "  antisymmetric part dropped: {share:%}",
    # workspace
    "orientation": "Orientation of M kept; position {position:5}",
    "freedoms": "The body takes {axes}; the rest of its pose follows",
    "no-workspace": "No workspace: singular everywhere",
    "volume": "Volume: {volume}, +- {error:2n} ({poses} poses tried)",
    "volume-at-orientation": "Volume with this orientation: {volume}, +- {error:2n} "
    "({poses} poses tried)",
    "turns": "The body turns about every axis by at least {least:4} at this position; "
    "{share:2} of all rotations",
    "sphere": "Largest sphere found inside: radius {size:4} at {centre:4}",
    "cube": "Largest cube found inside: edge {size:4} at {centre:4}",
    "tensions-any": "Tensions that count: any within the limits",
    "tensions-closed-form": "Tensions that count: nearest to the middle of the limits",
    "tensions": "Tensions nearest to the middle at the position: {tensions}",
    "ratio-of-legs": "Nearest to singular that was found: smallest over largest singular "
    "value of the legs' lines {ratio:3} at {at:4}; moments over the body's length "
    "{length}, 0 is singular",
    "ratio-of-twists": "Nearest to singular that was found: smallest over largest "
    "singular value of the passive joints' twists that meet in the body {ratio:3} at "
    "{at:4}; lengths over the body's length {length}, 0 is singular",
    "singular-pose": "Nearest singular pose found: {distance:4} away, by sqrt(distance^2 "
    "+ ({length} x angle)^2)",
    "singular-position": "Without turning the nearest singular pose is {shift:4} away",
    # design
    "study": "{subject}, {body_frame}: {designs} designs by {method}, {poses} pose(s) "
    "each",
    "case": "Load{of}: {load}",
    "feasible": "{feasible} feasible, {infeasible} infeasible, {failed} failed",
    "no-feasible-design": "No design is feasible: {infeasible} infeasible, {failed} "
    "failed",
    "more-designs": "  ... {count} more; -o FILE.csv and --json have all",
    "more-reasons": "  ... {count} other reasons",
}

#: Titles of tables, where these are not their names.
TITLES: dict[str, str] = {
    "assembly modes": "",
    "analysis": "Analysis of {what}, at {at}",
    "no analysis": "Analysis: there is neither stiffness nor compliance here",
    "principal stiffness": "Principal stiffness, the other three freedoms held, and free",
    "principal compliance": "Principal compliance, the other three freedoms held, and "
    "free",
    "directions": "Stiffness along and about lines through this point, other freedoms "
    "held, and free",
    "centres": "Centres, from {place} along the axes of the analysis",
    "indices": "Indices, angles multiplied by the characteristic length {length}",
    "eigenscrews": "Eigenscrews: twists answered by a wrench on the same screw",
    "wrench-compliant axes": "Wrench-compliant axes: translation answered by a parallel "
    "force",
    "twist-compliant axes": "Twist-compliant axes: moment answered by a parallel "
    "rotation",
    "modes by length": "Modes with respect to the metric length^2 |omega|^2 + |v|^2",
    "modes by inertia": "Modes with respect to the inertia of the body",
    "choice of connection": "",
    "connections": "Does the choice of connection matter here? Largest difference from "
    "K^{reference} by block (r rotation, t translation), and its relative size",
    "deflection": "Linear deflection (K^{connection}) under {wrench:4} at the point {at}",
    "shares of displacement": "  shares of the displacement",
    "shares of energy": "  shares of the energy",
    "wrenches": "Wrenches in joints, closures, links and lines, along each frame's axes",
    "target": "Joint stiffness for the target K^{connection}{order}",
    "target springs": "",
    "target matrix": "  matrix of joint stiffness that gives it exactly, rows and "
    "columns in order",
    "uncertainty": "Uncertainty from {of} (to first order; standard deviations)",
    "every spread": "  every number, with the interval that holds {level:%}",
    "what does not exist": "Does not exist here, or not to all digits",
    "stiffnesses": "Stiffness, {level} % intervals",
    "offsets": "Zeros and offsets, {level} % intervals",
    "predicted": "Predicted {level} % intervals of the file's stiffnesses",
    "deviations": "Predicted standard deviations of zeros and offsets",
    "by rows": "Widest interval with the number of rows",
    "displacement": "Displacement of the body frame, axes of F",
    "wrench": "{what}",
    "points": "",
    "errors": "",
    "commands": "Largest change of a command",
    "best": "Best of {name} [{unit}]",
    "energies": "Share of each coordinate in the kinetic energy, in per cent",
    "axes": "Screw axis of the body's motion, in its frame",
    "sensitivities of frequencies": "Sensitivities: change of each frequency in Hz",
    "sensitivities of stiffness": "Sensitivities: change of the diagonal of K^K in "
    "{rotation} and {translation}",
    "no sensitivities": "Sensitivities: none, as no stiffness matrix, and no frequency, "
    "exists at this posture",
    "accuracy": "Accuracy to first order: standard deviations ({factor:4} of them hold "
    "{level} per cent), and who contributes to the variance",
    "intervals": "Intervals that hold {level} per cent, to first order",
    "response": "Response: {kind} in {unit}, {low:6n} to {high:6}",
    "impedance": "Impedance controller: order {order}, {axes}, about the origin of "
    "{about!r}",
    "impedance stiffness": "  stiffness",
    "impedance damping": "  damping by double diagonalisation; units of the stiffness "
    "times s",
    "limits": "Limits that end the workspace (share of directions)",
    "rotations": "Limits that end the rotations at this position (share of directions)",
    "measures": "Objectives and constraints",
    "best design": "Best design",
    "front": "Pareto front: {count} designs, of which none is better in everything",
    "infeasible": "Why designs are infeasible",
    "failed": "Why designs fail",
}

_BY = {
    "load": "under the load",
    "added load": "under the added load",
    "preload": "when the wrench that holds it is taken away",
}
_OTHER = {"translation": "turn", "rotation": "move"}
_WITH_HELD = {"translation": "with turning blocked", "rotation": "with moving blocked"}
_TOWARDS = {"translation": "along", "rotation": "about"}
#: Angles [deg] from a line up to which a direction is along it, and up to which it is
#: almost so.
ALONG, ALMOST = 1.0, 20.0


def title(verdict: Verdict) -> str:
    """The sentence of a verdict, with the matrix that was read, if one was."""
    if not verdict.connection:
        return VERDICTS[verdict.code]
    part = "the symmetric part of " if verdict.symmetrised else ""
    return f"{VERDICTS[verdict.code]} ({part}K^{verdict.connection})"


def direction_words(
    direction: Vector, is_line: bool = True, is_upright: bool = True
) -> str:
    """A direction of the room in words: "almost vertical, 4 deg off z", "horizontal,
    along y".

    Parameters
    ----------
    direction : tuple of float
        A vector along the axes of F.
    is_line : bool
        Whether its sign means nothing.
    is_upright : bool
        Whether z is vertical.
    """
    size = math.hypot(*direction)
    x, y, z = (value / size for value in direction)
    off = math.degrees(math.atan2(math.hypot(x, y), abs(z)))
    up = "" if is_line else " upwards" if z > 0.0 else " downwards"
    vertical, horizontal = f"vertical{up}", "horizontal"
    if not is_upright:
        vertical, horizontal = f"along {_sign(z, is_line)}z", "in the xy plane"
    if off <= ALONG:
        return vertical
    axis = f"{off:.0f} deg off {_sign(z, is_line)}z"
    if off <= ALMOST:
        return f"almost {vertical}, {axis}"
    (near, name), (far, _) = sorted(((x, "x"), (y, "y")), key=lambda part: -abs(part[0]))
    beside = math.degrees(math.atan2(abs(far), abs(near)))
    name = f"{_sign(near, is_line)}{name}"
    across = f"along {name}" if beside <= ALONG else f"{beside:.0f} deg off {name}"
    if off >= 90.0 - ALONG:
        return f"{horizontal}, {across}"
    if off >= 90.0 - ALMOST:
        return f"almost {horizontal}, {90.0 - off:.0f} deg off the xy plane, {across}"
    return f"{axis} towards {name}"


def _sign(value: float, is_line: bool) -> str:
    return "-" if value < 0.0 and not is_line else ""


def vector_words(values: Sequence[float]) -> str:
    """A unit vector in brackets."""
    return f"({', '.join(f'{round(x, 2) + 0.0:g}' for x in values)})"


def displacement_words(answer: Answer) -> Iterator[str]:
    """How far the point moves, which way, and by which part."""
    moved, units = answer.displacement, answer.units
    if moved is None:
        return
    if not any((*moved.said.translation, *moved.said.rotation)):
        yield "The load moves nothing: the structure carries it"
        return
    what = "This point" if any(moved.point) else "The body frame"
    yield f"{what} {_moves(moved, answer)}{_beside(moved, units)}"
    if answer.shares is not None:
        yield share_words(answer.shares)


def settled_words(answer: Answer) -> str | None:
    """How far the point moves by the equilibrium, where it is not as to first order."""
    moved = answer.displacement
    if moved is None or moved.is_first_order:
        return None
    return f"By the equilibrium it {_moves(moved, answer)}"


def is_upright(answer: Answer) -> bool:
    """Whether z is vertical: gravity, if any is known, is along it."""
    gravity = None if answer.load is None else answer.load.gravity
    return gravity is None or not any(gravity[:2])


def _moves(moved: Displacement, answer: Answer) -> str:
    """Size, cause and direction of a displacement.

    Of the rotation where the point stays.
    """
    said, by = moved.said, _BY[moved.by]
    size = math.hypot(*said.translation)
    if size == 0.0:
        return f"stays and turns {math.degrees(math.hypot(*said.rotation)):.4g} deg {by}"
    which = direction_words(said.translation, False, is_upright(answer))
    return f"moves {engineering(size, answer.units.length)} {by}, {which}"


def _beside(moved: Displacement, units: Units) -> str:
    """What the displacement was computed from, and the other value where they differ."""
    linear = f"to first order, K^{moved.connection}"
    if moved.first_order is None:
        return " (by the equilibrium)"
    if moved.is_first_order:
        return f" ({linear})"
    far = engineering(math.hypot(*moved.first_order.translation), units.length)
    return f" (by the equilibrium; {far} {linear})"


def share_words(shares: Shares) -> str:
    """The joint, link or leg that contributes most; parts with equal shares together."""
    largest = abs(shares.parts[0].share)
    margin = numerics.NEGLIGIBLE_SHARE * largest
    alike = [p.name for p in shares.parts if abs(abs(p.share) - largest) <= margin]
    each = "each of " if len(alike) > 1 else ""
    of = {"displacement": "the first-order displacement", "energy": "its energy"}[
        shares.of
    ]
    words = (
        f"{percent(shares.parts[0].share)} of {of} comes from "
        f"{each}{listed(alike, most=6)}"
    )
    if abs(shares.rest) >= SMALLEST_SAID_REST:
        rest = percent(shares.rest)
        words += f"; the load and other potentials, no joint, contribute {rest}"
    return words


#: Rest of the shares from which on it is said.
SMALLEST_SAID_REST = 0.005


def percent(share: float) -> str:
    """A share in whole per cent."""
    return f"{round(100.0 * share) + 0} %"


def extreme_words(answer: Answer) -> Iterator[str]:
    """Softest and stiffest directions against forces and against moments."""
    for freedom in ("translation", "rotation"):
        soft, held, stiff = (
            answer.extreme(end, freedom, others)  # type: ignore[arg-type]
            for end, others in (
                ("softest", "free"),
                ("softest", "held"),
                ("stiffest", "free"),
            )
        )
        if soft is None:
            continue
        unit = answer.units.stiffness[freedom]
        guided = ""
        if held is not None and held.stiffness is not None:
            guided = f"; {engineering(held.stiffness, unit)} {_WITH_HELD[freedom]}"
        yield (
            f"Softest (free to {_OTHER[freedom]}): {engineering(soft.stiffness, unit)} "
            f"{where(soft, answer)}{guided}"
        )
        if stiff is not None:
            size = engineering(stiff.stiffness, unit)
            if stiff.stiffness is None:
                size = "held by the structure"
            yield f"Stiffest (free to {_OTHER[freedom]}): {size} {where(stiff, answer)}"


def where(extreme: Extreme, answer: Answer) -> str:
    """The direction of an extreme in words, with its vector in the room."""
    towards = _TOWARDS[extreme.freedom]
    if extreme.direction is None:
        return f"{towards} more than one direction alike"
    words = direction_words(extreme.direction, is_upright=is_upright(answer))
    return f"{towards} {vector_words(extreme.direction)} of the room, {words}"


def answer_sentences(answer: Answer) -> list[str]:
    """The sentences of an answer, without its doubts.

    The verdict comes first: it has a title, or is said by the statement of its code.
    """
    code = answer.verdict.code
    titles = [title(answer.verdict)] if code in VERDICTS else []
    statements = sorted(answer.statements, key=lambda one: one.code != code)
    return [
        *titles,
        *displacement_words(answer),
        *extreme_words(answer),
        *statement_sentences(answer, statements),
    ]


def statement_sentences(answer: Answer, statements: Iterable[Statement]) -> list[str]:
    """The sentences of statements, which may name the mechanism and its frame."""
    about: dict[str, Any] = {
        "subject": answer.subject,
        "kind": answer.kind,
        "body_frame": Frame(answer.frame, answer.frame_offset, answer.units.length),
    }
    if (load := answer.load) is not None:
        about["load"] = LoadKind(load.kind, load.at)  # type: ignore[arg-type]
        about["wrench"] = wrench_parts(load.force, load.moment, answer.units)
        about["at"] = Quantity(load.at, answer.units.length)
    return [sentence(SENTENCES[s.code], about | dict(s.values)) for s in statements]


def words_of(statements: Iterable[Statement]) -> list[str]:
    """Whole sentences of statements that need nothing but their own values."""
    return [f"{sentence(SENTENCES[s.code], s.values)}." for s in statements]


def sentence(template: str, values: Mapping[str, Any]) -> str:
    """A sentence with its values."""
    return _Words().vformat(template, (), values)


class _Words(Formatter):
    """Templates whose fields are written by `value_words`."""

    def format_field(self, value: Any, spec: str) -> str:
        """A value as people read it."""
        return value_words(value, spec)


def value_words(value: Any, spec: str = "") -> str:
    """A value as people read it; None as "-", lists with commas.

    Parameters
    ----------
    value : str, int, float, Quantity, list or None
        A quantity is written in the unit of texts, and with its unit.
    spec : str
        Digits, default 5, and a letter: f: so many decimal places; n: without the unit;
        e: in the unit of its size, such as kN; p: angles in both units; %: a share in per
        cent, with two digits; a: "and" before the last of a list.
    """
    letter = spec.lstrip("0123456789")
    digits = int(spec.removesuffix(letter) or 5)
    if isinstance(value, dict):
        return ", ".join(f"{key} {value_words(x, spec)}" for key, x in value.items())
    if isinstance(value, (list, tuple)):
        *words, last = [value_words(x, spec) for x in value] or [""]
        return ", ".join([*words, "and " * (letter == "a" and bool(words)) + last])
    if isinstance(value, Verdict):
        return title(value)
    if isinstance(value, Shares):
        return share_words(value)
    if isinstance(value, Frame):
        return layout.body_frame(vars(value), Units(value.length))
    if isinstance(value, Statement):
        return sentence(SENTENCES[value.code], value.values)
    if isinstance(value, Quantity):
        return _quantity_words(value, digits, letter)
    if letter == "f":
        return f"{round(value, digits) + 0.0:.{digits}f}"
    if letter == "%":
        return layout.percent(value)
    if isinstance(value, float):
        return layout.number(value, digits)
    return "-" if value is None else WORDS.get(str(value), str(value))


def _quantity_words(quantity: Quantity, digits: int, letter: str) -> str:
    """A number, or numbers in brackets, with the unit."""
    x, (unit, per) = quantity.value, shown_unit(quantity.unit)
    if isinstance(x, tuple):
        numbers = layout.vector([value and per * value for value in x], digits)
        return f"{numbers} {unit.removeprefix('1')}".rstrip()
    if letter == "n":
        return layout.number(x and per * x, digits)
    if unit == "1":
        return {"e": percent}.get(letter, layout.percent)(x or 0.0)
    if letter not in ("e", "p") or x is None:
        return f"{layout.number(x and per * x, digits)} {unit}"
    if quantity.unit == Units.angle:
        both = f"{x:.{digits}g} rad " * (letter == "p")
        return f"{both}{per * x + 0.0:.4g} {unit}"
    return engineering(x, quantity.unit, digits)


#: Words of codes, and of flags.
WORDS = {
    "determined": "",
    "True": "yes",
    "False": "NO",
    "linear in the load": "displacements linear in the load",
    "loaded equilibrium": "the equilibrium under load",
    "at-least": "at least",
    "not-identifiable": "not identifiable",
    "positive": "positive definite",
    "negative": "negative definite",
    "file": "its file",
    "by all": "all compliances (D-optimal)",
    "by worst": "the widest interval",
    "by posture": "the deflection at the test posture",
}
