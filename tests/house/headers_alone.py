"""headers_alone.py [--self-test]: where a header has a source file of its name, that file includes it first, so that
it is compiled with nothing before it. Headers without one are compiled alone by tests/house/CMakeLists.txt."""

import pathlib
import re
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]


def check(root):
    complaints, count = [], 0
    for kind in ("modules", "platform"):
        for header in sorted((root / kind).rglob("*.h")):
            source = header.with_suffix(".cpp")
            first = re.search(r'^\s*#\s*include\s*[<"]([^>"]+)', source.read_text(), re.M) if source.exists() else None
            count += source.exists()
            if source.exists() and (not first or first.group(1) != f"{header.parent.name}/{header.name}"):
                complaints.append(f"{source.relative_to(root)} does not include {header.parent.name}/{header.name} first")
            if "#pragma once" not in header.read_text():
                complaints.append(f"{header.relative_to(root)} has no #pragma once")
    return complaints, count


def self_test():
    with tempfile.TemporaryDirectory() as folder:
        house = pathlib.Path(folder)
        for path, text in {
            "modules/a/good.h": "#pragma once\n",
            "modules/a/good.cpp": '// Why.\n#include "a/good.h"\n#include <vector>\n',
            "modules/a/alone.h": "#pragma once\n",
            "modules/a/late.h": "#pragma once\n",
            "modules/a/late.cpp": '#include <vector>\n#include "a/late.h"\n',
            "platform/b/twice.h": "",
        }.items():
            (house / path).parent.mkdir(parents=True, exist_ok=True)
            (house / path).write_text(text)
        complaints, count = check(house)
        print(complaints)
        return count == 2 and [c.split(" ")[0] for c in complaints] == ["modules/a/late.cpp", "platform/b/twice.h"]


if __name__ == "__main__":
    if sys.argv[1:] == ["--self-test"]:
        sys.exit(0 if self_test() else 1)
    complaints, count = check(ROOT)
    print(f"{count} headers with a source file, {len(complaints)} complaints")
    print("\n".join(complaints))
    sys.exit(1 if complaints else 0)
