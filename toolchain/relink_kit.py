"""relink_kit.py ARCHITECTURE PROGRAM --out KIT.tar.gz: everything that is needed to link a static program anew with another
version of a library under the LGPL: wagonsight's own objects, the archives that were linked with them, and `relink`, which does
it. Before the kit is written it is tried in an empty folder: what it links must be the program, byte for byte."""

import argparse
import gzip
import pathlib
import shutil
import subprocess
import tarfile
import tempfile

from linked_program import LinkedProgram

README = """Link {name} for {architecture} anew
================================================
Replace an archive in libraries/ by your own build of that library (for example libc.a, libusb-1.0.a or libdc1394.a) and run

    ./relink [OUTPUT]

It needs {compiler}. Unchanged, it gives the program that was shipped, byte for byte.
"""


def collect(program, folder):
    """Copies what the link reads into `folder`; gives the link command with paths inside it."""
    with tempfile.TemporaryDirectory() as scratch:
        members = program.members(scratch)
    (folder / "libraries").mkdir()
    (folder / "objects").mkdir()
    libraries = f"{program.sysroot}/usr/lib/{program.architecture}-linux-gnu"
    # What is named by -l, and the start files, come from the pinned C library.
    for path in sorted(members):
        if path.is_relative_to(libraries):
            shutil.copy(path, folder / "libraries" / path.name)
    for script in pathlib.Path(libraries).glob("*.a"):  # libm.a may be a linker script, which the map does not name
        if script.read_bytes()[:2] == b"/*":
            shutil.copy(script, folder / "libraries" / script.name)
    command = []
    for word in program.command:
        path = program.build / word
        if word.endswith((".o", ".a")) and not word.startswith("-"):
            if path.is_relative_to(libraries):
                word = f"libraries/{path.name}"
            else:
                target = folder / "objects" / word
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(path, target)
                word = f"objects/{word}"
        word = word.replace(libraries, "libraries")
        if not word.startswith("-ffile-prefix-map"):
            command.append(word)
    command[0] = pathlib.Path(command[0]).name
    return command


def write(program, folder, command):
    compiler = (program.sysroot / "compiler").read_text().strip()
    (folder / "README").write_text(
        README.format(name=program.name, architecture=program.architecture, compiler=compiler))
    words = [("\"${1:-" + program.name + "}\"") if word == "@OUTPUT@" else f"'{word}'" for word in command]
    script = folder / "relink"
    script.write_text("#!/bin/sh\nset -e\ncd \"$(dirname \"$0\")\"\n" + " \\\n  ".join(words) + "\n")
    script.chmod(0o755)


def pack(folder, out, top):
    """The same input gives the same bytes: sorted, without times and owners."""
    def plain(member):
        member.mtime = member.uid = member.gid = 0
        member.uname = member.gname = ""
        member.mode = 0o755 if member.mode & 0o100 else 0o644
        return member

    with open(out, "wb") as raw, gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed:
        with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as archive:
            for path in sorted(folder.rglob("*")):
                if path.is_file():
                    archive.add(path, f"{top}/{path.relative_to(folder)}", filter=plain)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("architecture", choices=["x86_64", "aarch64"])
    parser.add_argument("program")
    parser.add_argument("--out", required=True, type=pathlib.Path)
    options = parser.parse_args()
    program = LinkedProgram(options.architecture, options.program)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name, "kit")
        folder.mkdir()
        command = collect(program, folder)
        command[command.index("-o") + 1] = "@OUTPUT@"
        write(program, folder, command)
        again = pathlib.Path(name, "again")
        subprocess.run([folder / "relink", again], check=True)
        if again.read_bytes() != program.path.read_bytes():
            raise SystemExit(f"relink_kit: the kit does not give {program.path} again; nothing was written")
        pack(folder, options.out, f"relink-{program.name}-{program.architecture}")
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.1f} MB, gives {program.name} again byte for byte")


if __name__ == "__main__":
    main()
