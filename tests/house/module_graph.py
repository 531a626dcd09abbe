"""module_graph.py [--root FOLDER] [--self-test]: holds every include of modules/, platform/ and apps/, and every
DEPENDS of their CMakeLists.txt, against tests/module_graph.txt. Exits 1 and names what is not planned."""

import argparse
import pathlib
import re
import sys
import tempfile

SOURCES = {".h", ".cpp", ".hpp", ".cc", ".c", ".inl"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^">]+)[">]', re.M)
DEPENDS = re.compile(r"wagonsight_(?:module|program)\(\s*(\S+)(.*?)\)", re.S)
KEYWORD = re.compile(r"^[A-Z_]+$")


class Plan:
    def __init__(self, text):
        self.points_to, self.owners, self.never_include, self.never_say = {}, {}, [], []
        for line in text.splitlines():
            line = line.split("#")[0].strip()
            if not line:
                continue
            name, _, rest = line.partition(": " if ": " in line else ":")
            if name.endswith(" belong to"):
                self.owners[name.removesuffix(" belong to").strip("<>")] = rest.split()
            elif name == "modules never include":
                self.never_include = [header.strip("<>") for header in rest.split()]
            elif name == "modules never say":
                self.never_say = rest.split()
            else:
                self.points_to[name] = rest.split()
        for name, targets in self.points_to.items():
            for target in targets:
                if target not in self.points_to:
                    raise SystemExit(f"module_graph.txt: {name} points to {target}, which is not planned")
        for name in self.points_to:
            if name in self.reach(name):
                raise SystemExit(f"module_graph.txt: {name} depends on itself")

    def reach(self, name):
        """Everything `name` may include."""
        found, waiting = set(), list(self.points_to[name])
        while waiting:
            target = waiting.pop()
            if target not in found:
                found.add(target)
                waiting += self.points_to[target]
        return found


def matches(header, pattern):
    return header.startswith(pattern[:-1]) if pattern[-1] in "*/" else header == pattern


def without_comments(text):
    """Comments and string literals turned into blanks; line numbers and includes stay."""
    keep_lines = lambda match: "\n" * match.group().count("\n")
    text = re.sub(r"/\*.*?\*/", keep_lines, text, flags=re.S)
    return re.sub(r"//[^\n]*", "", text)


def without_strings(text):
    return re.sub(r'"(?:\\.|[^"\\\n])*"', '""', text)


def part_of(path, root):
    """modules/voxel/octree.h is of `voxel`, platform/http/server.h of `platform/http`."""
    kind, name = path.relative_to(root).parts[:2]
    return name if kind == "modules" else f"{kind}/{name}"


def part_of_include(header, path, root):
    """The part a quoted include leads to; None when it is a neighbour in the same folder."""
    first = header.split("/")[0]
    if "/" in header:
        for part in (first, f"platform/{first}", f"apps/{first}"):
            folder = root / "modules" / first if part == first else root / part
            if folder.is_dir():
                return part
    written_by_cmake = path.parent.parent / f"{header}.in"
    return None if (path.parent / header).exists() or written_by_cmake.exists() else "?"


def check_file(path, root, plan, complain):
    part, text = part_of(path, root), without_comments(path.read_text())
    allowed = plan.reach(part) | {part}
    is_module = "/" not in part
    for match in INCLUDE.finditer(text):
        line = text[: match.start(2)].count("\n") + 1
        quoted, header = match.group(1) == '"', match.group(2)
        where = f"{path.relative_to(root)}:{line}"
        if quoted:
            target = part_of_include(header, path, root)
            if target == "?":
                complain(f'{where}: "{header}" is no header of a planned part')
            elif target is not None and target not in allowed:
                complain(f"{where}: {part} may not depend on {target} ({header})")
        for pattern, owners in plan.owners.items():
            if matches(header, pattern) and part not in owners:
                complain(f"{where}: <{header}> belongs to {', '.join(owners)}, not to {part}")
        if is_module and not quoted and any(matches(header, pattern) for pattern in plan.never_include):
            complain(f"{where}: <{header}> belongs to platform/ or apps/, not to a module")
    if is_module:
        for number, line in enumerate(without_strings(text).splitlines(), 1):
            for word in plan.never_say:
                if re.search(r"(?<!\w)" * word[0].isalpha() + re.escape(word), line):
                    complain(f"{path.relative_to(root)}:{number}: a module has no '{word}'; it is given what it needs")


def check_cmake(path, root, plan, complain):
    part = part_of(path, root)
    allowed = plan.reach(part) | {part}
    for match in DEPENDS.finditer(re.sub(r"#[^\n]*", "", path.read_text())):
        listening = False
        for word in match.group(2).split():
            if KEYWORD.match(word):
                listening = word == "DEPENDS"
            elif listening:
                target = word if word in plan.points_to else f"platform/{word}"
                if target in plan.points_to and target not in allowed:
                    complain(f"{path.relative_to(root)}: {part} may not link {target}")


def check(root):
    plan = Plan((root / "tests/module_graph.txt").read_text())
    complaints, files = [], 0
    for kind in ("modules", "platform", "apps"):
        for folder in sorted(path for path in (root / kind).iterdir() if path.is_dir()):
            if part_of(folder / "x", root) not in plan.points_to:
                complaints.append(f"{folder.relative_to(root)}: tests/module_graph.txt does not plan this part")
                continue
            for path in sorted(folder.rglob("*")):
                if path.suffix in SOURCES:
                    files += 1
                    check_file(path, root, plan, complaints.append)
                elif path.name == "CMakeLists.txt":
                    check_cmake(path, root, plan, complaints.append)
    return complaints, files


def self_test(root):
    """The check must pass what is planned and name each kind of offence, one at a time."""
    plan = (root / "tests/module_graph.txt").read_text()
    good = {
        "modules/base/base.h": "#include <vector>\n",
        "modules/geometry/geometry.h": '#include "base/base.h"\n',
        "modules/frame/frame.h": '#include "geometry/geometry.h"\n',
        "modules/frame/frame.cpp": '#include "frame/frame.h"\n#include "neighbour.h"\n',
        "modules/frame/neighbour.h": '// #include "people/people.h"\nconst char* kText = "::now(";\n',
        "modules/people/people.h": "",
        "modules/capture/capture.h": '#include "base/base.h"\n',  # reached through frame
        "modules/capture/CMakeLists.txt": "wagonsight_module(capture DEPENDS frame)\n",
        "platform/linux/clock.cpp": '#include <thread>\n#include "base/base.h"\nauto t = Clock::now();\n',
        "apps/wagonsight/main.cpp": '#include "people/people.h"\n#include <CLI/CLI.hpp>\n',
    }
    offences = {
        "an arrow up": ("modules/frame/frame.h", '#include "people/people.h"\n', "may not depend on people"),
        "an arrow up in a comment's shadow": (
            "modules/frame/frame.h", '/* x */ #include "people/people.h"\n', "may not depend on people"),
        "a module of the platform": ("modules/frame/frame.h", '#include "linux/clock.h"\n', "platform/linux"),
        "the solver in the operator's tool": (
            "apps/wagonsight/main.cpp", '#include "calibrate/solve.h"\n', "no header of a planned part"),
        "a thread": ("modules/frame/frame.cpp", "#include <thread>\n", "belongs to platform/ or apps/"),
        "a system call": ("modules/frame/frame.cpp", "#include <sys/mman.h>\n", "belongs to platform/ or apps/"),
        "a clock": ("modules/frame/frame.cpp", "auto t = std::chrono::steady_clock::now();\n", "'::now('"),
        "the environment": ("modules/frame/frame.cpp", 'auto t = std::getenv("HOME");\n', "getenv"),
        "another's library": ("modules/frame/frame.cpp", "#include <opencv2/core.hpp>\n", "belongs to calibrate"),
        "a lost header": ("modules/frame/frame.cpp", '#include "nowhere.h"\n', "no header of a planned part"),
        "an unplanned module": ("modules/misc/misc.h", "", "does not plan this part"),
        "an unplanned link": (
            "modules/capture/CMakeLists.txt", "wagonsight_module(capture DEPENDS base\n people)\n", "may not link people"),
    }
    failures = []
    for name, offence in [("what is planned", None), *offences.items()]:
        with tempfile.TemporaryDirectory() as folder:
            house = pathlib.Path(folder)
            files = dict(good, **{"tests/module_graph.txt": plan})
            if offence:
                files[offence[0]] = offence[1]
            for path, text in files.items():
                (house / path).parent.mkdir(parents=True, exist_ok=True)
                (house / path).write_text(text)
            complaints, _ = check(house)
            if (offence is None and complaints) or (
                offence and (len(complaints) != 1 or offence[2] not in complaints[0])):
                failures.append(f"{name}: {complaints}")
    print(f"{len(offences)} kinds of offence, {len(failures)} not told rightly")
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    if options.self_test:
        complaints = self_test(options.root)
    else:
        complaints, files = check(options.root)
        print(f"{files} files, {len(complaints)} not as planned")
    print("\n".join(complaints))
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
