#!/usr/bin/env python3
"""list.py SO - what a program that links libsplatfit depends on, one line each, sorted.

Functions with their types and the version of their symbol, structs with sizes, fields with types and offsets, and values
of enums, as a compiler for a 64-bit machine lays them out. CC is a compiler like gcc, NM its nm.
"""
import os
import re
import subprocess
import sys
import tempfile

ENTRY = re.compile(r"^ *<(\d+)><([0-9a-f]+)>: Abbrev Number: \d+ \((DW_TAG_\w+)\)")
ATTRIBUTE = re.compile(r"^ *<[0-9a-f]+> +(DW_AT_\w+) *: (.*)$")


def run(*command, text=None):
    return subprocess.run(command, input=text, check=True, capture_output=True, encoding="utf-8").stdout


def value_of(text):
    """What readelf shows of an attribute, without how it was stored."""
    text = re.sub(r"^\(.*?\): ", "", text.strip())
    text = re.sub(r"^\((?:indirect|indexed|data|line).*?\) *", "", text)
    return text.split("\t")[0].strip()


def entries(dump):
    """The debugging entries, each with its children, by offset; and the outermost ones."""
    found, path, outer = {}, [], []
    entry = None
    for line in dump.splitlines():
        match = ENTRY.match(line)
        if match:
            depth = int(match.group(1))
            entry = {"tag": match.group(3), "children": []}
            found[int(match.group(2), 16)] = entry
            path[depth:] = [entry]
            (path[depth - 1]["children"] if depth > 1 else outer).append(entry)
            continue
        match = ATTRIBUTE.match(line)
        if match and entry is not None:
            entry[match.group(1)] = value_of(match.group(2))
    return found, outer


def type_name(found, entry):
    """The name of an entry's type, as C writes it."""
    if "DW_AT_type" not in entry:
        return "void"
    target = found[int(re.search(r"0x([0-9a-f]+)", entry["DW_AT_type"]).group(1), 16)]
    tag, name = target["tag"], target.get("DW_AT_name", "")
    if tag == "DW_TAG_pointer_type":
        return type_name(found, target) + "*"
    if tag == "DW_TAG_const_type":
        return type_name(found, target) + " const"
    if tag == "DW_TAG_array_type":
        bounds = [int(c["DW_AT_upper_bound"], 0) + 1 if "DW_AT_upper_bound" in c else int(c["DW_AT_count"], 0)
                  for c in target["children"]]
        return type_name(found, target) + "".join(f"[{n}]" for n in bounds)
    if tag == "DW_TAG_subroutine_type":
        arguments = ", ".join(type_name(found, c) for c in target["children"])
        return f"{type_name(found, target)} ({arguments})"
    return name


def layouts(cc):
    """Lines for the structs and enums of the headers."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "all.o")
        run(*cc, "-g", "-gdwarf-4", "-fno-eliminate-unused-debug-types", "-Iinclude", "-c", "-o", path, "-x", "c", "-",
            text="#include <splatfit/splatfit.h>\n")
        found, outer = entries(run("readelf", "--debug-dump=info", path))
    for entry in outer:
        name = entry.get("DW_AT_name", "")
        named = name.startswith("sf_")
        if entry["tag"] == "DW_TAG_structure_type" and named and "DW_AT_byte_size" in entry:
            yield f"struct {name}: {int(entry['DW_AT_byte_size'], 0)} bytes"
            for field in entry["children"]:
                at = int(field["DW_AT_data_member_location"].split()[0], 0)
                yield f"struct {name}: at {at:4}: {type_name(found, field)} {field['DW_AT_name']}"
        if entry["tag"] == "DW_TAG_enumeration_type":
            for value in entry["children"]:
                if value["DW_AT_name"].startswith("SF_"):
                    owner = name if named else "values"
                    yield f"enum {owner}: {value['DW_AT_name']} = {int(value['DW_AT_const_value'], 0)}"


def functions(cc, so):
    """Lines for the functions of the headers, with the versions of their symbols in the library."""
    versions = {}
    for line in run(os.environ.get("NM", "nm"), "-D", "--defined-only", "--with-symbol-versions", so).splitlines():
        name, _, version = line.split()[-1].partition("@@")
        versions[name] = version
    plain = run(*cc, "-E", "-P", "-Iinclude", "-x", "c", "-", text="#include <splatfit/splatfit.h>\n")
    marked = re.findall(r'__attribute__\(\(visibility\("default"\)\)\)([^;]*);', plain)
    for declaration in marked:
        shown = re.sub(r"\s+", " ", declaration).strip()
        name = re.search(r"\b(sf_\w+)\(", shown).group(1)
        yield f"function {shown} @{versions.pop(name, 'MISSING') or 'NONE'}"
    for name in versions:
        if name.startswith("sf_"):
            yield f"function {name} is in no header"


def main():
    cc = os.environ.get("CC", "gcc").split()
    for line in sorted(list(layouts(cc)) + list(functions(cc, sys.argv[1]))):
        print(line)


main()
