"""hardened.py PROGRAM --bytes-max N | --self-test: holds that PROGRAM is a stripped static position-independent
executable with read-only relocations, no executable stack, no writable code, stack protector and fortified calls, that it
names no folder of the machine that built it, and that it is at most N bytes."""

import argparse
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]


def readelf(option, program):
    return subprocess.run(["readelf", "-W", option, program], capture_output=True, text=True, check=True).stdout


def complaints(program, bytes_max):
    found = []
    segments = [line.split() for line in readelf("-l", program).splitlines() if re.match(r"\s+[A-Z_]+\s+0x", line)]
    flags = {words[0]: "".join(words[6:-1]) for words in segments}
    dynamic = readelf("-d", program)
    content = pathlib.Path(program).read_bytes()
    if "Type:                              DYN" not in readelf("-h", program):
        found.append("is not position-independent")
    if "INTERP" in flags or "(NEEDED)" in dynamic:
        found.append("needs a loader or shared libraries")
    if "GNU_RELRO" not in flags or not re.search(r"BIND_NOW|\bNOW\b", dynamic):
        found.append("has relocations that stay writable")
    if "E" in flags.get("GNU_STACK", "E"):
        found.append("has an executable stack")
    if any(words[0] == "LOAD" and {"W", "E"} <= set("".join(words[6:-1])) for words in segments):
        found.append("has writable code")
    if ".symtab" in readelf("-S", program):
        found.append("is not stripped")
    if b"*** stack smashing detected ***" not in content and b"stack smashing detected" not in content:
        found.append("has no stack protector")
    if b"buffer overflow detected" not in content:
        found.append("has no fortified calls")
    if str(ROOT).encode() in content or b"/.cache/" in content:
        found.append("names a folder of the machine that built it")
    if len(content) > bytes_max:
        found.append(f"has {len(content)} bytes, more than {bytes_max}")
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", nargs="?")
    parser.add_argument("--bytes-max", type=int, default=1 << 22)
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    if options.self_test:  # an ordinary program is neither static nor small enough for a single byte
        found = complaints(sys.executable, 1)
        print(found)
        return 0 if "needs a loader or shared libraries" in found and any("more than 1" in one for one in found) else 1
    found = complaints(options.program, options.bytes_max)
    print(f"{pathlib.Path(options.program).name}: {pathlib.Path(options.program).stat().st_size} bytes")
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
