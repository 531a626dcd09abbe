"""bill_of_materials.py ARCHITECTURE PROGRAM [--out FILE]: what of others is in a static program, as CycloneDX 1.4: every
library the linker took something from and every library whose headers were compiled in, with the pinned package it comes from,
that package's SHA-256 and its licence. Fails for anything of which toolchain/components.txt knows no licence."""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from linked_program import ROOT, TOOLCHAIN, LinkedProgram


def read_components(text):
    """[(where it is found, package, licence)], the longest place first, so that the most precise one speaks."""
    rows = [line.split(None, 2) for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return sorted(rows, key=lambda row: -len(row[0]))


def find(rows, place, is_header):
    for where, package, licence in rows:
        if place.startswith(where) if is_header else place == where:
            return package, licence.strip()
    return None


def parts_of(program, rows):
    """{package: licence} and what is not known."""
    found, unknown = {}, set()
    with tempfile.TemporaryDirectory() as folder:
        members = program.members(folder)
    for archive in members:
        if archive.is_relative_to(ROOT):
            continue  # our own
        if archive.suffix == ".o":  # start files: of the C library, or of the compiler
            entry = find(rows, "libc.a" if archive.is_relative_to(program.sysroot) else "libgcc.a", False)
        else:
            entry = find(rows, archive.name, False)
        found.update([entry]) if entry else unknown.add(archive.name)
    for header in program.headers():
        entry = find(rows, header, True)
        found.update([entry]) if entry else unknown.add(header)
    return found, unknown


def component(package, licence, pins, program):
    if package == "compiler":
        version = (program.sysroot / "compiler").read_text().strip()
        return {"type": "library", "name": "GCC runtime (libstdc++, libgcc)", "version": version,
                "licenses": [{"expression": licence}]}
    version, sha256 = pins[package]
    debian = {"x86_64": "amd64", "aarch64": "arm64"}[program.architecture]
    return {"type": "library", "name": package, "version": version,
            "purl": f"pkg:deb/debian/{package}@{version.replace(':', '%3A').replace('+', '%2B')}?arch={debian}",
            "hashes": [{"alg": "SHA-256", "content": sha256}], "licenses": [{"expression": licence}]}


def bill(program, components):
    found, unknown = parts_of(program, read_components(components.read_text()))
    if unknown:
        raise SystemExit(f"{components.name} has no licence for: {', '.join(sorted(unknown))}")
    pins = {name: (version, sha256) for name, version, sha256 in
            (line.split() for line in (program.sysroot / "packages").read_text().splitlines())}
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True).stdout
    return {"bomFormat": "CycloneDX", "specVersion": "1.4", "version": 1,
            "metadata": {"component": {"type": "application", "name": program.name, "version": commit.strip() or "unknown",
                                       "licenses": [{"expression": "Apache-2.0"}]}},
            "components": [component(package, licence, pins, program) for package, licence in sorted(found.items())]}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("architecture", choices=["x86_64", "aarch64"])
    parser.add_argument("program")
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--components", type=pathlib.Path, default=TOOLCHAIN / "components.txt")
    options = parser.parse_args()
    text = json.dumps(bill(LinkedProgram(options.architecture, options.program), options.components), indent=1) + "\n"
    if options.out:
        options.out.write_text(text)
    else:
        sys.stdout.write(text)


if __name__ == "__main__":
    main()
