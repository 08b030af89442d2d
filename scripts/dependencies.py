#!/usr/bin/env python3
"""Lists the crates that lightsum is built of, with licences and numbers of `unsafe`, as docs/dependencies.md.

    scripts/dependencies.py > docs/dependencies.md

Exit code 1 if a licence is none of those that go with MIT and Apache-2.0. `unsafe` is counted as a word outside of comments and strings in
the sources of a crate, tests and examples left out; a large number tells of bindings and of vector instructions as much as of risk.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLATFORM = "x86_64-unknown-linux-gnu"
FREE = {
    "MIT", "Apache-2.0", "Zlib", "BSD-2-Clause", "BSD-3-Clause", "ISC", "0BSD", "Unlicense", "CC0-1.0", "Unicode-3.0", "OFL-1.1",
    "Ubuntu-font-1.0", "Apache-2.0 WITH LLVM-exception", "BSL-1.0",
}


def is_free(licence):
    """Whether an expression can be met by free licences alone: of OR one part, of AND all parts."""
    licence = licence.replace("/", " OR ")
    tokens = re.findall(r"\(|\)|\bAND\b|\bOR\b|[^()\s]+(?: WITH [^()\s]+)?", licence)

    def alternatives():
        value = parts()
        while tokens and tokens[0] == "OR":
            tokens.pop(0)
            value = parts() or value
        return value

    def parts():
        value = single()
        while tokens and tokens[0] == "AND":
            tokens.pop(0)
            value = single() and value
        return value

    def single():
        token = tokens.pop(0)
        if token != "(":
            return token in FREE
        value = alternatives()
        tokens.pop(0)
        return value

    return alternatives()


def count_unsafe(folder):
    count = 0
    for path in folder.rglob("*.rs"):
        if {"tests", "examples", "benches", "fuzz"} & set(path.relative_to(folder).parts[:-1]):
            continue
        text = path.read_text(errors="replace")
        text = re.sub(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\])*"', "", text, flags=re.S)
        count += len(re.findall(r"\bunsafe\b(?!_)", text))
    return count


def main():
    command = ["cargo", "metadata", "--locked", "--filter-platform", PLATFORM, "--format-version", "1"]
    data = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout)
    packages = {package["id"]: package for package in data["packages"]}
    nodes = {node["id"]: node for node in data["resolve"]["nodes"]}
    root = data["resolve"]["root"]

    def below(start, kinds):
        """Crates reached from one by dependencies of these kinds."""
        found, open_ones = set(), [start]
        while open_ones:
            for dependency in nodes[open_ones.pop()]["deps"]:
                wanted = any(kind["kind"] in kinds for kind in dependency["dep_kinds"])
                if wanted and dependency["pkg"] not in found:
                    found.add(dependency["pkg"])
                    open_ones.append(dependency["pkg"])
        return found

    direct = {d["pkg"] for d in nodes[root]["deps"] if any(k["kind"] is None for k in d["dep_kinds"])}
    linked = below(root, {None})
    built = below(root, {None, "build"})
    rows, refused = [], []
    for number in sorted(built, key=lambda number: (packages[number]["name"], packages[number]["version"])):
        package = packages[number]
        licence = package["license"] or "none stated"
        if not package["license"] or not is_free(licence):
            refused.append(f"{package['name']}: {licence}")
        use = "direct" if number in direct else "linked" if number in linked else "build"
        unsafe = count_unsafe(Path(package["manifest_path"]).parent)
        rows.append(f"| {package['name']} | {package['version']} | {licence} | {use} | {unsafe} |")
    print("# Dependencies\n")
    print(f"The {len(built)} crates of a build with default features on {PLATFORM}: {len(direct)} that lightsum names, {len(linked - direct)}")
    print(f"that these bring along, {len(built - linked)} that run while it is built. Tests and benchmarks have more. `unsafe` counts the word in")
    print("a crate's sources, tests left out. Made by `scripts/dependencies.py`, which refuses licences that do not go with MIT and Apache-2.0.\n")
    print("| crate | version | licence | use | `unsafe` |\n|---|---|---|---|---|")
    print("\n".join(rows))
    for line in refused:
        print(f"error: the licence of {line} is not free", file=sys.stderr)
    sys.exit(1 if refused else 0)


main()
