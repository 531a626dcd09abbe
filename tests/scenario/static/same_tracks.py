"""same_tracks.py --native PROGRAM -- PROGRAM...: this machine's everyday `wagonsight` and a static one (of another
architecture, behind its emulator) simulate the same scene and replay the same recording; what they tell must be the same,
byte for byte. Exits 77 (skipped) while the everyday program is not built."""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from small_wagon import SCENE

PASSENGERS = """
[[passenger]]
name = "walker"
height = 1.75
start = [1.5, 0.9]
[[passenger.do]]
at = 0.2
act = "walk"
to = [3.6, 1.8]
[[passenger]]
name = "standing"
height = 1.62
carries = ["bag"]
start = [2.8, 0.7]
"""
SECONDS = 2


def run(program, folder, *arguments):
    done = subprocess.run([*program, *arguments], cwd=folder, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, program))} {' '.join(arguments)}: ended with {done.returncode}: {done.stderr}")


def first_difference(left, right):
    lines = zip(left.decode().splitlines(), right.decode().splitlines())
    for number, (a, b) in enumerate(lines, 1):
        if a != b:
            return f"line {number}:\n  {a}\n  {b}"
    return "one has more lines"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--native", required=True, type=pathlib.Path)
    parser.add_argument("program", nargs="+")
    options = parser.parse_args()
    if not options.native.exists():
        print(f"skipped: {options.native} is not built")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "scene.toml").write_text(SCENE + PASSENGERS)
        told = {}
        for which, program in (("native", [options.native]), ("static", options.program)):
            run(program, folder, "simulate", "--scene", "scene.toml", "--seconds", str(SECONDS), "--seed", "3",
                "--out", f"{which}.mcap", "--truth", f"{which}.truth")
            run(program, folder, "replay", "native.mcap", "--out", f"{which}.people", "--background", "whole")
            told[which] = {end: (folder / f"{which}.{end}").read_bytes() for end in ("mcap", "truth", "people")}
        people = [json.loads(line)["people"] for line in told["native"]["people"].splitlines()]
        seen = sum(len(instant) for instant in people)
        print(f"{len(people)} instants, {seen} people told, {len(told['native']['mcap'])} bytes recorded")
        failures = [end for end in told["native"] if told["native"][end] != told["static"][end]]
        for end in failures:
            print(f"{end} differs;", "" if end == "mcap" else first_difference(told["native"][end], told["static"][end]))
        enough = 2 * seen > len(people)
        if not enough:
            print("too few people were told for this to show anything")
        return 1 if failures or not enough else 0


if __name__ == "__main__":
    sys.exit(main())
