"""linked_libraries.py PROGRAM LINKS | --self-test: holds the shared libraries that PROGRAM loads (by ldd) and the targets
that CMake links into it (LINKS, one a line) against tests/linked_libraries.txt."""

import fnmatch
import pathlib
import re
import subprocess
import sys

PLAN = pathlib.Path(__file__).resolve().parents[1] / "linked_libraries.txt"


def read_plan(text):
    plan = {}
    for line in text.splitlines():
        line = line.split("#")[0].strip()
        if line:
            name, _, rest = line.partition(": ")
            plan[name] = rest.split()
    return plan


def short_name(library):
    """/usr/lib/x86_64-linux-gnu/libpng16.so.16 is libpng16; ld-linux-x86-64.so.2 is ld-linux-x86-64."""
    return re.sub(r"\.so(\..*)?$", "", library.rsplit("/", 1)[-1])


def loaded_by(program):
    result = subprocess.run(["ldd", program], capture_output=True, text=True)
    if "not a dynamic executable" in result.stdout + result.stderr:
        return []  # a static program loads nothing
    if result.returncode != 0:
        raise SystemExit(f"ldd {program}: {result.stderr.strip()}")
    if "not found" in result.stdout:
        raise SystemExit(f"{program} does not find all its libraries:\n{result.stdout}")
    return [short_name(line.split()[0]) for line in result.stdout.splitlines()]


def complaints(plan, name, loaded, linked):
    found = []
    if f"{name} loads" in plan:
        allowed = plan["everywhere loads"] + plan[f"{name} loads"]
        found += [f"{name} loads {library}, which is not planned" for library in loaded if library not in allowed]
    for pattern in plan.get(f"{name} never links", []):
        found += [f"{name} links {target}" for target in linked if fnmatch.fnmatch(target, pattern)]
    return found


def self_test():
    plan = read_plan(PLAN.read_text())
    good = complaints(plan, "wagonsightd", ["libc", "libfmt"], ["wagonsight_pipeline"])
    loads = complaints(plan, "wagonsightd", [short_name("/usr/lib/libopencv_core.so.406")], [])
    links = complaints(plan, "wagonsight", [], ["wagonsight_calibrate", "OpenSSL::SSL", "opencv_core"])
    print("planned:", good, "loads:", loads, "links:", links)
    real = loaded_by(sys.executable)  # ldd itself must be understood
    return good == [] and len(loads) == 1 and len(links) == 3 and "libc" in real


def main():
    if sys.argv[1:] == ["--self-test"]:
        return 0 if self_test() else 1
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    program, links = map(pathlib.Path, sys.argv[1:])
    loaded, linked = loaded_by(program), links.read_text().split()
    found = complaints(read_plan(PLAN.read_text()), program.name, loaded, linked)
    print(f"{program.name} loads {len(loaded)} shared libraries, links {len(linked)} targets")
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
