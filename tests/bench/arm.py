#!/usr/bin/env python3
"""arm.py - what the hot loops of the kernels take on processors that are not here, as llvm-mca estimates it: a table.

Each kernel is compiled as the library has it, by gcc and by clang, and the innermost loops of its assembly are those that the table has:
a loop is a label and a branch back to it without another between; which one it is, its line numbers say. Beside them the AVX2
version of the same loops, whose time can be measured: splatfit bench --only kernels --isa avx2. Nothing here is a measured time of ARM.

COMPILERS  gcc and clang if unset: aarch64-linux-gnu-gcc, arm-linux-gnueabihf-gcc, and the newest clang for all
TARGETS    aarch64, armv7 and x86 if unset
"""
import os
import re
import shutil
import subprocess
import sys
import tempfile

FLAGS = ("-std=c11 -O3 -g1 -S -fPIC -ffp-contract=off -fno-math-errno -D_POSIX_C_SOURCE=200809L -Iinclude").split()
# Architecture: clang's triple, gcc, level and its flags, lanes, processors (name of llvm-mca, what it stands for).
TARGETS = {
    "aarch64": ("aarch64-linux-gnu", "aarch64-linux-gnu-gcc", "neon", [], 4,
                ["cortex-a53", "cortex-a55", "cortex-a57", "neoverse-n1", "neoverse-v1"]),
    "armv7": ("arm-linux-gnueabihf", "arm-linux-gnueabihf-gcc", "neon",
              ["-march=armv7-a+fp", "-mfloat-abi=hard", "-mfpu=neon-vfpv4"], 4, ["cortex-a9", "cortex-a57"]),
    "x86": ("x86_64-linux-gnu", "gcc", "avx2", ["-mavx2", "-mfma"], 8, ["skylake", "znver4"]),
}
# A loop: file, functions whose lines it has, and units an iteration for each lane: Gaussians' pixels, pixels or Gaussians.
LOOPS = [
    ("blend, pairs", "blend", ("opacities", "blend_block"), 4, "pair"),
    ("blend_bwd, opacities", "blend", ("opacities", "find_opacities"), 4, "pair"),
    ("blend_bwd, sums", "blend", ("blend_bwd_pair",), 1, "pair"),
    ("loss, filter along", "loss", ("filter_along",), 1, "pixel"),
    ("loss, filter down", "loss", ("filter_down",), 4, "pixel"),
    ("loss, compare", "loss", ("compare_row",), 1, "pixel"),
]
TARGET_CPU = {"cortex-a57": "cortex-a72"}


def newest(name):
    for version in range(30, 13, -1):
        if shutil.which(f"{name}-{version}"):
            return f"{name}-{version}"
    return shutil.which(name) and name


def functions_of(path):
    """The function that each line of a file of arch/vector is in."""
    names, name = [None], None
    for line in open(path, encoding="utf-8"):
        found = re.match(r"(?:VEC|static|void) [^;]*?(\w+)\(", line)
        name = found.group(1) if found else name
        names.append(name)
    return names


def loops_of(assembly, path):
    """Innermost loops: their instructions, and the functions of `path` that these are from."""
    names, wanted, at = functions_of(path), None, None
    lines, labels = [], {}
    for line in assembly.splitlines():
        text = re.split(r"//|@ |^\s*#", line)[0].strip()
        found = re.match(r'\.file\s+(\d+)\s+(?:"[^"]*"\s+)?"([^"]*)"', line.strip())
        if found and os.path.basename(found.group(2)) == os.path.basename(path) and "scalar" not in line:
            wanted = found.group(1)
        found = re.match(r"\.loc\s+(\d+)\s+(\d+)", text)
        if found:
            at = names[int(found.group(2))] if found.group(1) == wanted and int(found.group(2)) < len(names) else None
        elif re.match(r"[.\w$]+:$", text):
            labels[text[:-1]] = len(lines)
        elif text and not text.startswith("."):
            lines.append((text, at))
            at_of = re.match(r"(?:b\.?\w*|cbn?z|tbn?z|j\w+)\s+(?:[^,]+,\s*)*([.\w$]+)$", text)
            if at_of and at_of.group(1) in labels:
                yield_from = labels[at_of.group(1)]
                lines[-1] = (text, at, yield_from)
    for end, entry in enumerate(lines):
        if len(entry) == 3 and not any(len(e) == 3 and e[2] >= entry[2] for e in lines[entry[2]:end]):
            body = lines[entry[2]:end + 1]
            yield [e[0] for e in body], {e[1] for e in body}


def is_vector(text):
    return re.search(r"\bv\d+\.|\bq\d+|%ymm", text) is not None


def mca(tool, triple, cpu, body):
    """Cycles, instructions and bound of an iteration, and what has the most work."""
    rounds = 200
    run = subprocess.run([tool, f"-mtriple={triple}", f"-mcpu={cpu}", f"-iterations={rounds}", *(["-mattr=+neon,+vfp4"] if triple.startswith("arm-") else [])],
                         input="\n".join(body) + "\n", capture_output=True, text=True)
    if run.returncode:
        return [line for line in run.stderr.splitlines() if "error" in line][:1] or ["failed"]
    value = lambda name: float(re.search(name + r":\s+([\d.]+)", run.stdout).group(1))
    units = re.search(r"Resource pressure per iteration:\n(.*)\n(.*)\n", run.stdout)
    named = dict(re.findall(r"^\[([\d.]+)\]\s+- (\S+)", run.stdout, re.M))
    pressure = [(float(p), named.get(n, n)) for n, p in zip(re.findall(r"\[([\d.]+)\]", units.group(1)),
                                                            re.findall(r"[\d.]+|-", units.group(2))) if p != "-"]
    most = max(pressure, default=(0, "nothing"))
    issue = value("Instructions") / rounds / value("Dispatch Width")
    by = f"{most[1]} {most[0]:.1f}" if most[0] >= issue else f"issue {issue:.1f}"
    return value("Total Cycles") / rounds, value("Instructions") / rounds, value("Block RThroughput"), by


def compiled(compiler, target, cpu, kernel, folder):
    triple, gcc, level, flags, _, _ = TARGETS[target]
    cpu = TARGET_CPU.get(cpu, cpu)
    tuned = [f"-mcpu={cpu}"] if target == "aarch64" else [f"-mtune={cpu}"] if target == "x86" and cpu != "znver4" else []
    command = [gcc] if compiler == "gcc" else [newest("clang"), f"--target={triple}"]
    out = os.path.join(folder, "kernel.s")
    run = subprocess.run([*command, *FLAGS, *flags, *tuned, f"-DSF_LEVEL={level}", f"-DSF_LEVEL_{level}", "-o", out,
                          f"arch/vector/{kernel}.c"], capture_output=True, text=True)
    if run.returncode:
        return None, (run.stderr.strip().splitlines() or ["failed"])[0]
    return open(out, encoding="utf-8").read(), None


def rows(tool, folder, compilers):
    for target in os.environ.get("TARGETS", " ".join(TARGETS)).split():
        triple, gcc, _, _, lanes, cpus = TARGETS[target]
        for compiler in compilers if target != "x86" else ["gcc"]:
            if not shutil.which(gcc if compiler == "gcc" else newest("clang") or "clang"):
                print(f"| {target}, {compiler} | not installed: skipped ||||||||")
                continue
            for cpu in cpus:
                texts = {}
                for name, kernel, functions, steps, unit in LOOPS:
                    if kernel not in texts:
                        texts[kernel] = compiled(compiler, target, cpu, kernel, folder)
                    text, error = texts[kernel]
                    if not text:
                        print(f"| {target}, {compiler} | {cpu} | {name} | cannot be compiled: {error} |||||")
                        continue
                    found = [body for body, of in loops_of(text, f"arch/vector/{kernel}.c")
                             if set(functions) <= of and sum(map(is_vector, body)) >= 8]
                    if not found:
                        print(f"| {target}, {compiler} | {cpu} | {name} | no such loop: it was unrolled or split |||||")
                        continue
                    # Versions of a loop (with depth, with clamps) do more work than the one that runs most.
                    result = mca(tool, triple, cpu, min(found, key=len))
                    if len(result) == 1:
                        print(f"| {target}, {compiler} | {cpu} | {name} | {tool} refuses it: {result[0]} |||||")
                        continue
                    cycles, count, bound, by = result
                    print(f"| {target}, {compiler} | {cpu} | {name} | {count:.0f} | {cycles:.1f} | {bound:.1f} | {by} | "
                          f"{cycles / (lanes * steps):.2f} a {unit} |")


def main():
    tool = newest("llvm-mca")
    if not tool:
        print("skipped: llvm-mca is not installed: make deps-bench, or Debian's package llvm-19")
        return
    version = re.search(r"version ([\d.]+)", subprocess.run([tool, "--version"], capture_output=True, text=True).stdout)
    print(f"{tool}, version {version.group(1) if version else 'not known'}\n")
    print("| built for, by | model | loop | instructions | cycles | bound | most work | |\n"
          "| --- | --- | --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        rows(tool, folder, os.environ.get("COMPILERS", "gcc clang").split())


main()
