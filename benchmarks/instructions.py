"""What the machine code for J, W and four matrices of a UR5 consists of, by length of vectors.

python benchmarks/instructions.py [NAME OF A PROCESSOR ...]

Instructions of the loop body as LLVM emits it, over the postures that one round of it serves. No
processor moves numbers between lanes more than once or twice a cycle, or issues more than some six
instructions: the counts bound the time from below where the memory does not.
"""

from __future__ import annotations

import re
import sys
from collections import Counter

import llvmlite.binding as llvm
import numpy as np

import cartstiff
from cartstiff.recorded.execution import lanes
from cartstiff.recorded.plans import plan, program_for
from cartstiff.recorded.tape import Program
from cartstiff.recorded.vector_code import vector_code

OUTPUTS = ("jacobian", "wrench", *(f"stiffness_{c}" for c in "ABKF"))
REST = [0.1, -0.7, 0.9, 0.2, 0.4, -0.3]
#: Kinds of instructions, the first that fits; of those on the stack also whether they are spills.
KINDS = {
    "arithmetic": r"v(add|sub|mul|fn?m|max|min)\w*p[sd]$",
    "divisions, roots": r"v(div|sqrt)",
    "between lanes": r"v(perm|unpck|shuf|insert|extract|blend|broadcast)",
    "stores past the cache": r"vmovnt",
    "moves": r"vmov",
    "other vectors": r"v",
    "scalar": r"",
}


def counted(program: Program, width: int, processor: str, features: str) -> Counter[str]:
    """Instructions of every kind in the code for vectors of `width` numbers."""
    target = llvm.Target.from_default_triple()
    machine = target.create_target_machine(cpu=processor, features=features, opt=2)
    module = llvm.parse_assembly(vector_code(program, width, True))
    module.triple = llvm.get_process_triple()
    found: Counter[str] = Counter()
    for line in machine.emit_assembly(module).splitlines():
        words = line.split("#")[0].split()
        if not words or words[0].startswith(".") or words[0].endswith(":"):
            continue
        found[next(kind for kind, form in KINDS.items() if re.match(form, words[0]))] += 1
        found["all"] += 1
        if words[0].startswith("v") and "(%rsp)" in line:
            found["of them on the stack"] += 1
    return found


def main(processors: list[str]) -> None:
    """Print a row per processor and length of vectors."""
    lanes()  # readies LLVM
    elastic = cartstiff.load("ur5").with_springs(rest=np.array(REST))
    chosen = plan(elastic)
    if isinstance(chosen, str):
        raise SystemExit(chosen)
    program = program_for(chosen.case, OUTPUTS)
    host = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    columns = ["all", *KINDS, "of them on the stack"]
    print(f"{program.size} operations a posture; instructions a posture:\n")
    print("| processor | numbers | " + " | ".join(columns) + " |")
    print("|---|---:|" + "---:|" * len(columns))
    for name, features in [host, *((name, "") for name in processors)]:
        for width in (4, 8):
            found = counted(program, width, name, features)
            row = " | ".join(f"{found[column] / width:.0f}" for column in columns)
            print(f"| {name} | {width} | {row} |")


if __name__ == "__main__":
    main(sys.argv[1:] or ["skylake-avx512", "znver4", "haswell"])
